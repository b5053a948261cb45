// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_config
// Seeds: config/parts
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "config/load.h"
#include "hal/spine.h"
#include "tests/fuzz/reached.h"

namespace {
bendloop::Reached accepted("a part that is accepted");
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto part = bendloop::config::ParsePart(text, "part.toml");
  if (!part) return 0;
  accepted.Mark();
  // What was accepted is a tube: exactly one nominal, with a finite length.
  if (part->rows.rows.empty() == part->xyz_mm.empty()) __builtin_trap();
  if (!(part->pipe_radius_mm > 0)) __builtin_trap();
  if (!std::isfinite(bendloop::hal::SpineLength(part->rows))) __builtin_trap();
  return 0;
}
