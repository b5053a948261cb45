// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/tray.h"

#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>

namespace bendloop::drivers {

hal::Result<std::filesystem::path> LayOnTray(const std::filesystem::path& tray,
                                             std::uint32_t serial, double pipe_radius_mm,
                                             const hal::ProgramBlock& commanded,
                                             const hal::BendProgram& tube) {
  nlohmann::ordered_json part{
      {"schema", "bendloop.tray/1"},      {"serial", serial},
      {"pipe_radius_mm", pipe_radius_mm}, {"part_number", commanded.part_number},
      {"sequence", commanded.sequence},   {"rows", nlohmann::ordered_json::array()}};
  for (const hal::BendRow& row : tube.rows) {
    nlohmann::ordered_json line{{"length_mm", row.length_mm},
                                {"rotation_deg", row.rotation_deg},
                                {"angle_deg", row.angle_deg},
                                {"bend_radius_mm", nullptr}};
    if (row.bend_radius_mm) line["bend_radius_mm"] = *row.bend_radius_mm;
    part["rows"].push_back(std::move(line));
  }
  char name[32];
  std::snprintf(name, sizeof name, "part-%04u.json", serial);
  const std::filesystem::path file = tray / name;
  const std::filesystem::path unfinished = tray / (std::string(".") + name + ".tmp");
  std::error_code error;
  std::filesystem::create_directories(tray, error);
  {
    std::ofstream out(unfinished, std::ios::trunc);
    out << part.dump(2) << '\n';
    out.close();
    if (!out) {
      return hal::Fail(hal::ErrorKind::kBadInput, "tray " + tray.string() + ": cannot write " +
                                                      unfinished.string() +
                                                      "; expected a folder that can be written");
    }
  }
  std::filesystem::rename(unfinished, file, error);
  if (error) {
    return hal::Fail(hal::ErrorKind::kBadInput, "tray " + tray.string() + ": " + error.message());
  }
  return file;
}

}  // namespace bendloop::drivers
