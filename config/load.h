// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <string_view>

#include "config/cell_config.h"
#include "config/part_config.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::config {

// A longer configuration file is refused unread.
inline constexpr std::size_t kMaxFileBytes = 1 << 20;

// From file to structs. Errors are kBadInput and name every problem of the file: the first line of
// the message is a summary when there are several, then one line a problem,
// `FILE:LINE: key 'x.y': found ..., expected ...; did you mean 'z'?`.

// The cell with its part and its register map.
hal::Result<CellConfig> LoadCell(const std::filesystem::path& file);
hal::Result<PartConfig> LoadPart(const std::filesystem::path& file);
hal::Result<hal::RegisterMap> LoadRegisterMap(const std::filesystem::path& file);

// Whether the bender's register map can carry the cell's part; kBadInput says what does not fit.
hal::Result<void> CheckPartFits(const CellConfig& cell);

// From text; `name` stands for the file in messages. ParseCell resolves paths against `directory`
// but opens nothing: the part and the register map stay empty.
hal::Result<CellConfig> ParseCell(std::string_view toml, std::string_view name,
                                  const std::filesystem::path& directory = {});
hal::Result<PartConfig> ParsePart(std::string_view toml, std::string_view name);
hal::Result<hal::RegisterMap> ParseRegisterMap(std::string_view toml, std::string_view name);

enum class FileKind { kCell, kPart, kRegisterMap, kObjectDictionary };

// "cell", "part", "register map", "object dictionary".
std::string_view Name(FileKind kind);

// Loads whatever the file's `schema` says it is, a cell with all that it names; a file whose name
// ends in .eds as an object dictionary.
hal::Result<FileKind> ValidateFile(const std::filesystem::path& file);

}  // namespace bendloop::config
