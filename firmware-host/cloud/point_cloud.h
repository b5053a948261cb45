// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "hal/result.h"

namespace bendloop::host {

// What the numbers in a file mean; files do not say.
enum class Units { kMillimetres, kMetres, kInches };

// "mm", "m" or "in"; kUsage for anything else.
hal::Result<Units> UnitsFromName(std::string_view name);
double MillimetresPer(Units units);

// An unorganised cloud.
struct PointCloud {
  std::vector<Eigen::Vector3d> points_mm;  // finite, in the order of the file
  std::size_t dropped_non_finite = 0;      // points with NaN or infinite coordinates, left out
  std::string format;                      // what the file turned out to be, for a person
  std::vector<std::string> warnings;       // for a person, one sentence each
};

// Files beyond either limit are refused before memory is taken for them.
inline constexpr std::size_t kMaxCloudPoints = 200'000'000;
inline constexpr std::size_t kMaxCloudBytes = std::size_t{16} << 30;

// Reads PLY (ascii, binary of both byte orders, meshes too), PCD (ascii, binary, binary_compressed)
// or text with any delimiter; the content decides, not the name. `path` may be a named pipe.
// kBadInput says path, line or byte offset, what was found and what was expected.
hal::Result<PointCloud> ReadCloud(const std::string& path, Units units);

// The same for bytes in memory; `name` stands for the path in messages.
hal::Result<PointCloud> ParseCloud(std::string_view bytes, std::string_view name, Units units);

}  // namespace bendloop::host
