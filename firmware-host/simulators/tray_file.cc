// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/simulators/tray_file.h"

#include <filesystem>
#include <fstream>
#include <optional>

#include "firmware-host/result/program_json.h"

namespace bendloop::host {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr std::uintmax_t kMaxTrayBytes = 4 << 20;

}  // namespace

Result<TrayPart> ReadTray(const std::string& file) {
  std::error_code no_size;
  const auto size = std::filesystem::file_size(file, no_size);
  std::ifstream in(file);
  if (no_size || !in || size > kMaxTrayBytes) {
    return Fail(ErrorKind::kBadInput,
                file + ": cannot be read; expected a tray file (JSON) of at most 4 MiB");
  }
  const Json json = Json::parse(in, nullptr, false);
  if (json.is_discarded()) return Fail(ErrorKind::kBadInput, file + ": is not JSON");
  std::optional<hal::Error> error;
  const JsonReader reader(json, file, error);
  const std::string schema = reader.At("schema").Text();
  TrayPart part;
  if (reader.Has("serial")) part.serial = reader.At("serial").Count32();
  part.tube.pipe_radius_mm = reader.At("pipe_radius_mm").Number();
  part.tube.program = ReadRows(reader.At("rows"));
  if (error) return Fail(*error);
  if (schema != "bendloop.tray/1") {
    return Fail(ErrorKind::kBadInput,
                file + ": schema is \"" + schema + "\", expected \"bendloop.tray/1\"");
  }
  return part;
}

}  // namespace bendloop::host
