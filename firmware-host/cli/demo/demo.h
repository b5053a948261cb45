// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "hal/result.h"

namespace bendloop::host {

struct DemoOptions {
  std::filesystem::path out = "demo-out";
  std::uint32_t parts = 3;
  std::uint64_t seed = 1;
  bool colour = true;
  bool quick = false;  // a coarser scan, for tests
};

// The whole main job with three processes of our own: bendloop-simbender, bendloop-simscanner and
// bendloopd, over loopback. kRefused when the second part is not better than the first.
hal::Result<void> RunDemo(const DemoOptions& options);

}  // namespace bendloop::host
