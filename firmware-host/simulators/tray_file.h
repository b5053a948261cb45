// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "hal/result.h"
#include "hal/tube.h"

namespace bendloop::host {

// A part as it truly is, which the simulated bender has laid on its tray.
struct TrayPart {
  std::uint32_t serial = 1;
  hal::Tube tube;
};

// Reads a tray file (JSON, schema "bendloop.tray/1"); kBadInput.
hal::Result<TrayPart> ReadTray(const std::string& file);

}  // namespace bendloop::host
