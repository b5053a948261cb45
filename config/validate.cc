// SPDX-License-Identifier: Apache-2.0
#include <string>
#include <vector>

#include "config/load.h"
#include "config/object_dictionary.h"
#include "config/parse_file.h"

namespace bendloop::config {
namespace {

constexpr FileKind kKinds[] = {FileKind::kCell, FileKind::kPart, FileKind::kRegisterMap};

std::string KnownSchemas() {
  std::string text;
  for (const FileKind kind : kKinds) {
    text += (text.empty() ? "'" : ", '") + std::string(Schema(kind)) + "'";
  }
  return text;
}

}  // namespace

std::string_view Name(FileKind kind) {
  switch (kind) {
    case FileKind::kCell:
      return "cell";
    case FileKind::kPart:
      return "part";
    case FileKind::kRegisterMap:
      return "register map";
    case FileKind::kObjectDictionary:
      return "object dictionary";
  }
  return "unknown";
}

std::string_view Schema(FileKind kind) {
  switch (kind) {
    case FileKind::kCell:
      return "bendloop.cell/1";
    case FileKind::kPart:
      return "bendloop.part/1";
    case FileKind::kRegisterMap:
      return "bendloop.register-map/1";
    case FileKind::kObjectDictionary:
      break;  // an EDS names no schema
  }
  return "unknown";
}

void CheckSchema(TomlDocument& document, FieldVisitor& v, FileKind kind) {
  std::string schema;
  const std::size_t before = document.problem_count();
  v.Text("schema", schema, Need::kOptional);
  if (document.problem_count() > before || schema == Schema(kind)) return;
  document.Report("schema",
                  (schema.empty() ? "found nothing" : "found '" + Printable(schema) + "'") +
                      ", expected '" + std::string(Schema(kind)) + "'" +
                      (schema.empty() ? " as the first line of a " : " of a ") +
                      std::string(Name(kind)) + " file");
}

hal::Result<FileKind> ValidateFile(const std::filesystem::path& file) {
  if (file.extension() == ".eds" || file.extension() == ".EDS") {
    const hal::Result<ObjectDictionary> eds = LoadObjectDictionary(file);
    if (!eds) return hal::Fail(eds.error());
    return FileKind::kObjectDictionary;
  }
  const hal::Result<std::string> text = ReadTextFile(file);
  if (!text) return hal::Fail(text.error());
  const hal::Result<TomlDocument> document = TomlDocument::Parse(*text, file.string());
  if (!document) return hal::Fail(document.error());
  const std::string schema = document->root()["schema"].value_or(std::string());
  const auto outcome = [](FileKind kind, const auto& loaded) -> hal::Result<FileKind> {
    if (!loaded) return hal::Fail(loaded.error());
    return kind;
  };
  if (schema == Schema(FileKind::kCell)) return outcome(FileKind::kCell, LoadCell(file));
  if (schema == Schema(FileKind::kPart)) return outcome(FileKind::kPart, LoadPart(file));
  if (schema == Schema(FileKind::kRegisterMap)) {
    return outcome(FileKind::kRegisterMap, LoadRegisterMap(file));
  }
  std::vector<std::string_view> words;
  for (const FileKind kind : kKinds) words.push_back(Schema(kind));
  const std::string_view near = Nearest(schema, words);
  return hal::Fail(
      hal::ErrorKind::kBadInput,
      file.string() + ":1: key 'schema': found " +
          (schema.empty() ? std::string("nothing") : "'" + Printable(schema) + "'") +
          ", expected one of " + KnownSchemas() +
          (near.empty() ? std::string() : "; did you mean '" + std::string(near) + "'?"));
}

}  // namespace bendloop::config
