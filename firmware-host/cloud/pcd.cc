// SPDX-License-Identifier: Apache-2.0
// PCD 0.5 to 0.7, the Point Cloud Library's format.
#include <liblzf/lzf.h>

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "firmware-host/cloud/formats.h"
#include "firmware-host/cloud/text.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kMostHeaderLines = 10'000;
constexpr std::size_t kMostFields = 10'000;
// The longest run that LZF can encode is 264 bytes, in three.
constexpr std::size_t kMostLzfRatio = 88;

struct Field {
  std::string name;
  std::size_t size = 4;
  char type = 'F';
  std::size_t count = 1;
  std::size_t offset = 0;  // in a point, bytes
  std::size_t column = 0;  // in a line of text

  std::size_t bytes() const { return size * count; }
};

struct Header {
  std::vector<Field> fields;
  std::size_t points = 0;
  std::size_t stride = 0;  // bytes of a point
  std::size_t values = 0;  // in a line of text
  std::size_t points_line = 0;
  std::size_t fields_line = 0;
  std::string data;  // ascii, binary or binary_compressed
};

struct Words {
  std::vector<std::string_view> words;
  explicit Words(std::string_view rest) {
    for (auto word = NextWord(rest); !word.empty() && words.size() <= kMostFields;
         word = NextWord(rest)) {
      words.push_back(word);
    }
  }
};

std::optional<ScalarType> TypeOf(const Field& field) {
  switch (field.type) {
    case 'F':
      if (field.size == 4) return ScalarType::kFloat;
      if (field.size == 8) return ScalarType::kDouble;
      return std::nullopt;
    case 'I':
      if (field.size == 1) return ScalarType::kInt8;
      if (field.size == 2) return ScalarType::kInt16;
      if (field.size == 4) return ScalarType::kInt32;
      if (field.size == 8) return ScalarType::kInt64;
      return std::nullopt;
    case 'U':
      if (field.size == 1) return ScalarType::kUint8;
      if (field.size == 2) return ScalarType::kUint16;
      if (field.size == 4) return ScalarType::kUint32;
      if (field.size == 8) return ScalarType::kUint64;
      return std::nullopt;
    default:
      return std::nullopt;
  }
}

class HeaderParser {
 public:
  HeaderParser(Lines& lines, std::string_view name) : lines_(lines), name_(name) {}

  hal::Result<Header> Parse() {
    std::string_view line;
    while (lines_.Next(line)) {
      if (lines_.number() > kMostHeaderLines) break;
      std::string_view rest = line;
      const std::string_view keyword = NextWord(rest);
      if (keyword.empty() || keyword.front() == '#') continue;
      const auto entry = ParseEntry(keyword, rest);
      if (!entry) return hal::Fail(entry.error());
      if (keyword == "DATA") return Finish();
    }
    return BadLine(name_, lines_.number(),
                   "the header ends without a DATA line; the file is cut off");
  }

 private:
  hal::Result<void> ParseEntry(std::string_view keyword, std::string_view rest) {
    const Words values(rest);
    if (keyword == "VERSION" || keyword == "VIEWPOINT") return {};
    if (keyword == "FIELDS" || keyword == "COLUMNS") {
      if (!header_.fields.empty()) return Bad("a second FIELDS line, expected one");
      header_.fields_line = lines_.number();
      if (values.words.size() > kMostFields) return Bad("more than 10000 fields");
      for (const auto word : values.words) header_.fields.push_back({std::string(word)});
      return {};
    }
    if (keyword == "SIZE" || keyword == "TYPE" || keyword == "COUNT") {
      if (values.words.size() != header_.fields.size()) {
        return Bad(std::string(keyword) + " has " + std::to_string(values.words.size()) +
                   " entries, expected one for each of the " +
                   std::to_string(header_.fields.size()) + " FIELDS");
      }
      for (std::size_t i = 0; i < values.words.size(); ++i) {
        Field& field = header_.fields[i];
        if (keyword == "TYPE") {
          if (values.words[i] != "F" && values.words[i] != "I" && values.words[i] != "U") {
            return Bad("TYPE " + Found(values.words[i]) + ", expected F, I or U");
          }
          field.type = values.words[i].front();
          continue;
        }
        const auto count = CountFrom(values.words[i]);
        const std::size_t most = keyword == "SIZE" ? 8 : 1'000'000;
        if (!count || *count < 1 || *count > most) {
          return Bad(std::string(keyword) + " " + Found(values.words[i]) +
                     ", expected a whole number from 1 to " + std::to_string(most));
        }
        (keyword == "SIZE" ? field.size : field.count) = *count;
      }
      return {};
    }
    if (keyword == "WIDTH" || keyword == "HEIGHT" || keyword == "POINTS") {
      const auto count = values.words.size() == 1 ? CountFrom(values.words[0]) : std::nullopt;
      if (!count)
        return Bad(std::string(keyword) + " " + Found(Trimmed(rest)) + ", expected a whole number");
      (keyword == "WIDTH" ? width_ : keyword == "HEIGHT" ? height_ : points_) = *count;
      header_.points_line = lines_.number();
      return {};
    }
    if (keyword == "DATA") {
      header_.data = values.words.empty() ? "" : std::string(values.words[0]);
      if (header_.data != "ascii" && header_.data != "binary" &&
          header_.data != "binary_compressed") {
        return Bad("DATA " + Found(header_.data) + ", expected ascii, binary or binary_compressed");
      }
      return {};
    }
    return Bad("found " + Found(keyword) +
               ", expected VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS or "
               "DATA");
  }

  hal::Result<Header> Finish() {
    if (header_.fields.empty())
      return Bad("no FIELDS line before DATA, expected e.g. FIELDS x y z");
    for (Field& field : header_.fields) {
      field.offset = header_.stride;
      field.column = header_.values;
      header_.stride += field.bytes();
      header_.values += field.count;
    }
    const std::size_t height = height_.value_or(1);
    if (width_ && height != 0 && *width_ > std::numeric_limits<std::size_t>::max() / height) {
      return Bad("WIDTH times HEIGHT does not fit a number");
    }
    if (!points_ && !width_) return Bad("neither POINTS nor WIDTH before DATA");
    header_.points = points_ ? *points_ : *width_ * height;
    if (points_ && width_ && *points_ != *width_ * height) {
      return BadLine(name_, header_.points_line,
                     "POINTS " + std::to_string(*points_) + ", but WIDTH times HEIGHT is " +
                         std::to_string(*width_ * height) + "; expected the same number");
    }
    if (header_.points > kMaxCloudPoints) {
      return BadLine(name_, header_.points_line,
                     std::to_string(header_.points) + " points, expected at most " +
                         std::to_string(kMaxCloudPoints));
    }
    return header_;
  }

  tl::unexpected<hal::Error> Bad(const std::string& message) const {
    return BadLine(name_, lines_.number(), message);
  }

  Lines& lines_;
  std::string_view name_;
  Header header_;
  std::optional<std::size_t> width_, height_, points_;
};

hal::Result<std::array<const Field*, 3>> FindCoordinates(const Header& header,
                                                         std::string_view name) {
  std::array<const Field*, 3> found{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string axis(1, "xyz"[i]);
    for (const Field& field : header.fields) {
      if (Lower(field.name) != axis) continue;
      if (found[i]) {
        return BadLine(name, header.fields_line,
                       "field " + axis + " stands twice, expected it once");
      }
      found[i] = &field;
    }
    if (!found[i]) {
      std::string names;
      for (const Field& field : header.fields) names += (names.empty() ? "" : " ") + field.name;
      return BadLine(name, header.fields_line,
                     "no field " + axis + " (found " + Found(names) + "), expected x, y and z");
    }
    if (found[i]->count != 1 || !TypeOf(*found[i])) {
      return BadLine(name, header.fields_line,
                     "field " + axis + " has TYPE " + found[i]->type + ", SIZE " +
                         std::to_string(found[i]->size) + ", COUNT " +
                         std::to_string(found[i]->count) +
                         "; expected one F of 4 or 8 bytes or one I or U of 1, 2, 4 or 8");
    }
  }
  return found;
}

// Where point i's coordinate stands: `begin + i * step`.
struct Column {
  const char* begin = nullptr;
  std::size_t step = 0;
  ScalarType type = ScalarType::kFloat;
};

void ReadColumns(const std::array<Column, 3>& columns, std::size_t points, double mm_per_unit,
                 PointCloud& cloud) {
  cloud.points_mm.reserve(points);
  PointSink sink(cloud, mm_per_unit);
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < points; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const Column& column = columns[axis];
      point[axis] = ReadScalar(column.begin + i * column.step, column.type, false);
    }
    sink.Add(point);
  }
}

std::uint32_t LittleEndian32(const char* data) {
  return static_cast<std::uint32_t>(ReadScalar(data, ScalarType::kUint32, false));
}

// Compressed data hold all values of the first field, then all of the second, and so on.
hal::Result<void> ReadCompressed(std::string_view bytes, std::size_t offset, const Header& header,
                                 const std::array<const Field*, 3>& fields, std::string_view name,
                                 double mm_per_unit, PointCloud& cloud) {
  if (bytes.size() - offset < 8) {
    return BadByte(name, bytes.size(),
                   "the file ends before the two sizes of the compressed data; copy or export it "
                   "again");
  }
  const std::size_t compressed = LittleEndian32(bytes.data() + offset);
  const std::size_t plain = LittleEndian32(bytes.data() + offset + 4);
  const std::size_t begin = offset + 8;
  if (compressed > bytes.size() - begin) {
    return BadByte(name, offset,
                   std::to_string(compressed) + " compressed bytes stated, but " +
                       std::to_string(bytes.size() - begin) +
                       " follow; the file is cut off, copy or export it again");
  }
  if (plain != header.points * header.stride) {
    return BadByte(name, offset + 4,
                   std::to_string(plain) + " uncompressed bytes stated, expected " +
                       std::to_string(header.points * header.stride) + " for " +
                       std::to_string(header.points) + " points of " +
                       std::to_string(header.stride) + " bytes");
  }
  if (plain == 0) return {};
  if (plain / kMostLzfRatio > compressed) {
    return BadByte(name, offset + 4,
                   std::to_string(plain) + " uncompressed bytes stated, but " +
                       std::to_string(compressed) + " compressed bytes cannot hold them");
  }
  std::vector<char> data(plain);
  const unsigned int got =
      lzf_decompress(bytes.data() + begin, static_cast<unsigned int>(compressed), data.data(),
                     static_cast<unsigned int>(plain));
  if (got != plain) {
    return BadByte(name, begin,
                   "the compressed data are damaged (" + std::to_string(got) + " of " +
                       std::to_string(plain) + " bytes came out); copy or export the file again");
  }
  std::array<Column, 3> columns;
  for (std::size_t i = 0; i < 3; ++i) {
    columns[i] = {data.data() + fields[i]->offset * header.points, fields[i]->size,
                  *TypeOf(*fields[i])};
  }
  ReadColumns(columns, header.points, mm_per_unit, cloud);
  return {};
}

hal::Result<void> ReadBinary(std::string_view bytes, std::size_t offset, const Header& header,
                             const std::array<const Field*, 3>& fields, std::string_view name,
                             double mm_per_unit, PointCloud& cloud) {
  const std::size_t readable = (bytes.size() - offset) / header.stride;
  if (readable < header.points) {
    return BadByte(name, bytes.size(),
                   "the file ends after " + std::to_string(readable) + " of " +
                       std::to_string(header.points) +
                       " points that its header states; copy or export it again");
  }
  std::array<Column, 3> columns;
  for (std::size_t i = 0; i < 3; ++i) {
    columns[i] = {bytes.data() + offset + fields[i]->offset, header.stride, *TypeOf(*fields[i])};
  }
  ReadColumns(columns, header.points, mm_per_unit, cloud);
  return {};
}

}  // namespace

bool IsPcd(std::string_view bytes) {
  if (bytes.substr(0, 6) == "# .PCD") return true;
  Lines lines(bytes.substr(0, 4096));
  std::string_view line;
  while (lines.Next(line)) {
    const std::string_view keyword = NextWord(line);
    if (keyword.empty() || keyword.front() == '#') continue;
    return keyword == "VERSION" || keyword == "FIELDS" || keyword == "COLUMNS";
  }
  return false;
}

hal::Result<PointCloud> ParsePcd(std::string_view bytes, std::string_view name,
                                 double mm_per_unit) {
  Lines lines(bytes);
  const auto header = HeaderParser(lines, name).Parse();
  if (!header) return hal::Fail(header.error());
  const auto fields = FindCoordinates(*header, name);
  if (!fields) return hal::Fail(fields.error());

  PointCloud cloud;
  cloud.format = "PCD " + header->data;
  hal::Result<void> read;
  if (header->data == "ascii") {
    TextTable table;
    table.count = header->points;
    table.values = header->values;
    for (std::size_t i = 0; i < 3; ++i) table.columns[i] = (*fields)[i]->column;
    read = ReadTextTable(lines, name, table, mm_per_unit, cloud);
  } else if (header->data == "binary") {
    read = ReadBinary(bytes, lines.offset(), *header, *fields, name, mm_per_unit, cloud);
  } else {
    read = ReadCompressed(bytes, lines.offset(), *header, *fields, name, mm_per_unit, cloud);
  }
  if (!read) return hal::Fail(read.error());
  return cloud;
}

}  // namespace bendloop::host
