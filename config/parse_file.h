// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "config/load.h"
#include "config/toml_document.h"
#include "config/toml_reader.h"
#include "hal/result.h"

namespace bendloop::config {

// "bendloop.cell/1" and so on.
std::string_view Schema(FileKind kind);

// Reports a `schema` that is not this kind's.
void CheckSchema(TomlDocument& document, FieldVisitor& v, FileKind kind);

// Text to struct: parse, read every field, then `check` what one field alone cannot show.
// `value` holds the defaults.
template <class T, class Visit, class Check>
hal::Result<T> ParseDocument(std::string_view toml, std::string_view name, FileKind kind,
                             const std::filesystem::path& directory, Visit visit, Check check,
                             T value) {
  hal::Result<TomlDocument> document = TomlDocument::Parse(toml, std::string(name));
  if (!document) return hal::Fail(document.error());
  TomlReader reader(*document, document->root(), "", directory);
  CheckSchema(*document, reader, kind);
  // Of a file of another kind every key would be wrong; that helps nobody.
  if (document->problem_count() == 0) {
    visit(reader, value);
    reader.Finish();
    check(*document, value);
  }
  if (hal::Result<void> finished = document->Finish(); !finished) {
    return hal::Fail(finished.error());
  }
  return value;
}

}  // namespace bendloop::config
