// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "firmware-host/cloud/point_cloud.h"
#include "hal/result.h"

// The readers behind ParseCloud, one a format, and what they share. Each checks every size that a
// file states against the bytes that are there before it takes memory.
namespace bendloop::host {

hal::Result<PointCloud> ParsePly(std::string_view bytes, std::string_view name, double mm_per_unit);
hal::Result<PointCloud> ParsePcd(std::string_view bytes, std::string_view name, double mm_per_unit);
hal::Result<PointCloud> ParseXyz(std::string_view bytes, std::string_view name, double mm_per_unit);

bool IsPly(std::string_view bytes);
bool IsPcd(std::string_view bytes);

// kBadInput at a line ("name:12: ...") or byte ("name: byte 1234: ...").
tl::unexpected<hal::Error> BadLine(std::string_view name, std::size_t line,
                                   const std::string& message);
tl::unexpected<hal::Error> BadByte(std::string_view name, std::size_t offset,
                                   const std::string& message);

enum class ScalarType {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kInt64,
  kUint64,
  kFloat,
  kDouble
};

std::size_t SizeOf(ScalarType type);
// `data` holds SizeOf(type) bytes, at any alignment.
double ReadScalar(const char* data, ScalarType type, bool big_endian);

// Keeps the finite points.
class PointSink {
 public:
  PointSink(PointCloud& cloud, double mm_per_unit) : cloud_(cloud), mm_per_unit_(mm_per_unit) {}

  void Add(const Eigen::Vector3d& point) {
    const Eigen::Vector3d point_mm = mm_per_unit_ * point;
    if (point_mm.allFinite()) {
      cloud_.points_mm.push_back(point_mm);
    } else {
      ++cloud_.dropped_non_finite;
    }
  }
  std::size_t added() const { return cloud_.points_mm.size() + cloud_.dropped_non_finite; }

 private:
  PointCloud& cloud_;
  double mm_per_unit_;
};

// Points as lines of text with a fixed number of values each: ascii PLY and PCD. `columns` are
// those of x, y and z. Adds `count` points; stops before memory is taken for more than fit.
class Lines;
struct TextTable {
  std::size_t count = 0;   // points stated by the header
  std::size_t values = 0;  // in each line
  std::size_t columns[3] = {};
  bool more_allowed = false;  // values beyond `values` (lists)
};
hal::Result<void> ReadTextTable(Lines& lines, std::string_view name, const TextTable& table,
                                double mm_per_unit, PointCloud& cloud);

}  // namespace bendloop::host
