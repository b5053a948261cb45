// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "config/load.h"
#include "config/object_dictionary.h"
#include "config/parse_file.h"
#include "hal/folder.h"

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

namespace {

// What the PLC could set and would not get: a part's file that is spoilt, or a number that stands
// in two.
hal::Result<void> CheckPartsDir(const CellConfig& cell) {
  if (cell.parts_dir.empty()) return {};
  std::string problems;
  const auto add = [&](const std::string& what) {
    problems += (problems.empty() ? "" : "\n") + what;
  };
  std::error_code error;
  std::vector<std::filesystem::path> files{cell.part_file};
  for (const std::filesystem::path& path : hal::PathsIn(cell.parts_dir, error)) {
    std::error_code none;
    if (path.extension() != ".toml") continue;
    if (!std::filesystem::equivalent(path, cell.part_file, none)) files.push_back(path);
  }
  if (error) {
    add(cell.file.string() + ": key 'parts_dir': found '" + cell.parts_dir.string() +
        "', which cannot be read: " + error.message());
  }
  std::sort(files.begin() + 1, files.end());
  std::map<std::uint32_t, std::filesystem::path> numbers;
  for (const std::filesystem::path& file : files) {
    CellConfig of_part = cell;
    auto part = LoadPart(file);
    if (!part) {
      add(part.error().message);
      continue;
    }
    of_part.part = std::move(*part);
    of_part.part_file = file;
    if (auto fits = CheckPartFits(of_part); !fits) add(fits.error().message);
    const auto [known, is_new] = numbers.emplace(of_part.part.part_number, file);
    if (is_new) continue;
    add(file.string() + ": key 'part_number': found " + std::to_string(known->first) +
        ", expected another one than " + known->second.string() + " has");
  }
  if (problems.empty()) return {};
  return hal::Fail(hal::ErrorKind::kBadInput, problems);
}

}  // namespace

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
  if (schema == Schema(FileKind::kCell)) {
    const auto cell = LoadCell(file);
    if (!cell) return hal::Fail(cell.error());
    return outcome(FileKind::kCell, CheckPartsDir(*cell));
  }
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
