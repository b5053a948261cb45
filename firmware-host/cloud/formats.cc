// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cloud/formats.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <utility>

#include "firmware-host/cloud/text.h"

namespace bendloop::host {
namespace {

static_assert(std::endian::native == std::endian::little, "ReadScalar swaps for big-endian files");

template <class T>
double Read(const char* data, bool big_endian) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, data, sizeof(T));
  if (big_endian) std::reverse(bytes, bytes + sizeof(T));
  return static_cast<double>(std::bit_cast<T>(bytes));
}

}  // namespace

tl::unexpected<hal::Error> BadLine(std::string_view name, std::size_t line,
                                   const std::string& message) {
  return hal::Fail(hal::ErrorKind::kBadInput,
                   std::string(name) + ":" + std::to_string(line) + ": " + message);
}

tl::unexpected<hal::Error> BadByte(std::string_view name, std::size_t offset,
                                   const std::string& message) {
  return hal::Fail(hal::ErrorKind::kBadInput,
                   std::string(name) + ": byte " + std::to_string(offset) + ": " + message);
}

std::size_t SizeOf(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
    case ScalarType::kUint8:
      return 1;
    case ScalarType::kInt16:
    case ScalarType::kUint16:
      return 2;
    case ScalarType::kInt32:
    case ScalarType::kUint32:
    case ScalarType::kFloat:
      return 4;
    case ScalarType::kInt64:
    case ScalarType::kUint64:
    case ScalarType::kDouble:
      return 8;
  }
  return 0;
}

double ReadScalar(const char* data, ScalarType type, bool big_endian) {
  switch (type) {
    case ScalarType::kInt8:
      return Read<std::int8_t>(data, big_endian);
    case ScalarType::kUint8:
      return Read<std::uint8_t>(data, big_endian);
    case ScalarType::kInt16:
      return Read<std::int16_t>(data, big_endian);
    case ScalarType::kUint16:
      return Read<std::uint16_t>(data, big_endian);
    case ScalarType::kInt32:
      return Read<std::int32_t>(data, big_endian);
    case ScalarType::kUint32:
      return Read<std::uint32_t>(data, big_endian);
    case ScalarType::kInt64:
      return Read<std::int64_t>(data, big_endian);
    case ScalarType::kUint64:
      return Read<std::uint64_t>(data, big_endian);
    case ScalarType::kFloat:
      return Read<float>(data, big_endian);
    case ScalarType::kDouble:
      return Read<double>(data, big_endian);
  }
  return 0;
}

hal::Result<void> ReadTextTable(Lines& lines, std::string_view name, const TextTable& table,
                                double mm_per_unit, PointCloud& cloud) {
  // A value takes a digit and something that ends it, so the bytes left bound the points.
  const std::size_t most = (lines.rest().size() + 1) / (2 * std::max<std::size_t>(1, table.values));
  cloud.points_mm.reserve(std::min(table.count, most));
  PointSink sink(cloud, mm_per_unit);
  std::string_view line;
  while (sink.added() < table.count) {
    if (!lines.Next(line)) {
      return BadByte(name, lines.offset(),
                     "the file ends after " + std::to_string(sink.added()) + " of " +
                         std::to_string(table.count) +
                         " points that its header states; copy or export it again");
    }
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    std::string_view rest = line;
    std::size_t column = 0;
    for (std::string_view word = NextWord(rest); !word.empty(); word = NextWord(rest), ++column) {
      for (int i = 0; i < 3; ++i) {
        if (table.columns[i] != column) continue;
        const auto value = NumberFrom(word);
        if (!value) {
          return BadLine(name, lines.number(),
                         "found " + Found(word) + " as " + "xyz"[i] + ", expected a number");
        }
        point[i] = *value;
      }
    }
    if (column == 0) continue;  // a blank line
    if (column < table.values || (column > table.values && !table.more_allowed)) {
      return BadLine(name, lines.number(),
                     "found " + std::to_string(column) + " values, expected " +
                         std::to_string(table.values) + " as the header states");
    }
    sink.Add(point);
  }
  return {};
}

}  // namespace bendloop::host
