// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdlib>

#include "firmware-host/cloud/point_cloud.h"
#include "tests/fuzz/reached.h"

namespace bendloop {

inline Reached cloud_accepted("a cloud that is accepted");

// What holds for every input: points are finite, no more than the bytes can state, and an error is
// one line that says something.
inline void CheckCloud(const hal::Result<host::PointCloud>& cloud, std::size_t bytes) {
  if (!cloud) {
    if (cloud.error().kind != hal::ErrorKind::kBadInput || cloud.error().message.empty() ||
        cloud.error().message.find('\n') != std::string::npos) {
      std::abort();
    }
    return;
  }
  cloud_accepted.Mark();
  if (cloud->points_mm.size() + cloud->dropped_non_finite > 100 * bytes + 1) std::abort();
  for (const auto& point : cloud->points_mm) {
    if (!point.allFinite()) std::abort();
  }
}

}  // namespace bendloop
