// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "hal/bend_program.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Lays a bent part, as it truly is, on the tray: `part-0001.json`, schema "bendloop.tray/1". The
// file appears whole or not at all. Returns its path; kBadInput if the folder cannot be written.
hal::Result<std::filesystem::path> LayOnTray(const std::filesystem::path& tray,
                                             std::uint32_t serial, double pipe_radius_mm,
                                             const hal::ProgramBlock& commanded,
                                             const hal::BendProgram& tube);

}  // namespace bendloop::drivers
