// SPDX-License-Identifier: Apache-2.0
// PLY as G. Turk described it (1994), and as its many writers took it.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firmware-host/cloud/formats.h"
#include "firmware-host/cloud/text.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kMostHeaderLines = 10'000;

struct Property {
  std::string name;
  ScalarType type = ScalarType::kFloat;  // of the items, for a list
  std::optional<ScalarType> list_count;  // a list: type of its leading count
};

struct Element {
  std::string name;
  std::size_t count = 0;
  std::size_t line = 0;  // of the header
  std::vector<Property> properties;

  bool has_list() const {
    return std::any_of(properties.begin(), properties.end(),
                       [](const Property& p) { return p.list_count.has_value(); });
  }
  // Bytes of an instance in a binary file, the items of its lists not counted.
  std::size_t fixed_size() const {
    std::size_t size = 0;
    for (const Property& p : properties) size += SizeOf(p.list_count.value_or(p.type));
    return size;
  }
};

enum class Encoding { kAscii, kLittleEndian, kBigEndian };

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::string encoding_name;
  std::vector<Element> elements;
};

std::optional<ScalarType> TypeFrom(std::string_view name) {
  static constexpr std::array<std::pair<std::string_view, ScalarType>, 18> kTypes = {{
      {"char", ScalarType::kInt8},
      {"int8", ScalarType::kInt8},
      {"uchar", ScalarType::kUint8},
      {"uint8", ScalarType::kUint8},
      {"short", ScalarType::kInt16},
      {"int16", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},
      {"uint16", ScalarType::kUint16},
      {"int", ScalarType::kInt32},
      {"int32", ScalarType::kInt32},
      {"uint", ScalarType::kUint32},
      {"uint32", ScalarType::kUint32},
      {"int64", ScalarType::kInt64},
      {"uint64", ScalarType::kUint64},
      {"float", ScalarType::kFloat},
      {"float32", ScalarType::kFloat},
      {"double", ScalarType::kDouble},
      {"float64", ScalarType::kDouble},
  }};
  for (const auto& [known, type] : kTypes) {
    if (known == name) return type;
  }
  return std::nullopt;
}

hal::Result<Property> ParseProperty(std::string_view rest, std::string_view name,
                                    std::size_t line) {
  const auto type_error = [&](std::string_view found) {
    return BadLine(name, line,
                   "property type " + Found(found) +
                       ", expected char, uchar, short, ushort, int, uint, float or double");
  };
  Property property;
  std::string_view type = NextWord(rest);
  if (type == "list") {
    const std::string_view count_type = NextWord(rest);
    property.list_count = TypeFrom(count_type);
    if (!property.list_count) return type_error(count_type);
    if (*property.list_count == ScalarType::kFloat || *property.list_count == ScalarType::kDouble) {
      return BadLine(name, line,
                     "list counted by " + Found(count_type) + ", expected an integer type");
    }
    type = NextWord(rest);
  }
  const auto known = TypeFrom(type);
  if (!known) return type_error(type);
  property.type = *known;
  property.name = std::string(NextWord(rest));
  if (property.name.empty()) return BadLine(name, line, "property without a name");
  return property;
}

// One line of the header each: what follows the keyword.
hal::Result<void> TakeFormat(std::string_view rest, std::string_view name, std::size_t line,
                             Header& header) {
  header.encoding_name = std::string(NextWord(rest));
  if (header.encoding_name == "ascii") {
    header.encoding = Encoding::kAscii;
  } else if (header.encoding_name == "binary_little_endian") {
    header.encoding = Encoding::kLittleEndian;
  } else if (header.encoding_name == "binary_big_endian") {
    header.encoding = Encoding::kBigEndian;
  } else {
    return BadLine(name, line,
                   "format " + Found(header.encoding_name) +
                       ", expected ascii, binary_little_endian or binary_big_endian");
  }
  return {};
}

hal::Result<void> TakeElement(std::string_view rest, std::string_view name, std::size_t line,
                              Header& header) {
  Element element;
  element.line = line;
  element.name = std::string(NextWord(rest));
  const std::string_view count_text = NextWord(rest);
  const auto count = CountFrom(count_text);
  if (!count) {
    return BadLine(name, line, "element count " + Found(count_text) + ", expected a whole number");
  }
  element.count = *count;
  header.elements.push_back(std::move(element));
  return {};
}

hal::Result<void> TakeProperty(std::string_view rest, std::string_view name, std::size_t line,
                               Header& header) {
  if (header.elements.empty()) return BadLine(name, line, "property before any element");
  auto property = ParseProperty(rest, name, line);
  if (!property) return hal::Fail(property.error());
  Element& element = header.elements.back();
  for (const Property& other : element.properties) {
    if (other.name == property->name) {
      return BadLine(name, line,
                     "property " + Found(property->name) + " stands twice in element " +
                         Found(element.name) + ", expected it once");
    }
  }
  element.properties.push_back(std::move(*property));
  return {};
}

hal::Result<Header> ParseHeader(Lines& lines, std::string_view name) {
  Header header;
  std::string_view line;
  lines.Next(line);  // "ply"
  while (true) {
    if (!lines.Next(line)) {
      return BadLine(name, lines.number(),
                     "the header ends without end_header; the file is cut off");
    }
    const std::size_t number = lines.number();
    if (number > kMostHeaderLines) {
      return BadLine(name, number, "no end_header so far; expected a PLY header");
    }
    std::string_view rest = line;
    const std::string_view keyword = NextWord(rest);
    if (keyword.empty() || keyword == "comment" || keyword == "obj_info") continue;
    if (keyword == "end_header") break;
    const auto taken = keyword == "format"     ? TakeFormat(rest, name, number, header)
                       : keyword == "element"  ? TakeElement(rest, name, number, header)
                       : keyword == "property" ? TakeProperty(rest, name, number, header)
                                               : BadLine(name, number,
                                                         "found " + Found(keyword) +
                                                             ", expected format, element, "
                                                             "property, comment or end_header");
    if (!taken) return hal::Fail(taken.error());
  }
  if (header.encoding_name.empty()) {
    return BadLine(name, lines.number(),
                   "the header has no format line, expected e.g. \"format ascii 1.0\"");
  }
  return header;
}

// Where x, y and z stand among the vertex's properties.
hal::Result<std::array<std::size_t, 3>> FindCoordinates(const Element& vertex,
                                                        std::string_view name) {
  std::array<std::size_t, 3> found{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string axis(1, "xyz"[i]);
    const auto& all = vertex.properties;
    const auto it = std::find_if(all.begin(), all.end(),
                                 [&](const Property& p) { return Lower(p.name) == axis; });
    if (it == all.end()) {
      std::string names;
      for (const Property& p : all) names += (names.empty() ? "" : " ") + p.name;
      return BadLine(name, vertex.line,
                     "the vertices have no property " + axis + " (they have: " +
                         (names.empty() ? "none" : Found(names)) + "), expected x, y and z");
    }
    if (it->list_count) {
      return BadLine(name, vertex.line, "property " + axis + " is a list, expected a number");
    }
    found[i] = static_cast<std::size_t>(it - all.begin());
  }
  return found;
}

// Walks through the bytes of a binary file; every step is checked.
class Walker {
 public:
  Walker(std::string_view bytes, std::size_t offset, bool big_endian)
      : bytes_(bytes), offset_(offset), big_endian_(big_endian) {}

  std::size_t offset() const { return offset_; }
  std::size_t left() const { return bytes_.size() - offset_; }
  const char* here() const { return bytes_.data() + offset_; }
  bool Skip(std::size_t size) {
    if (size > left()) return false;
    offset_ += size;
    return true;
  }
  // Past one property of an instance; false when the bytes end or a list has a negative count.
  bool Skip(const Property& property) {
    if (!property.list_count) return Skip(SizeOf(property.type));
    const std::size_t count_size = SizeOf(*property.list_count);
    if (count_size > left()) return false;
    const double count = ReadScalar(here(), *property.list_count, big_endian_);
    offset_ += count_size;
    const std::size_t most = left() / SizeOf(property.type);
    if (count < 0 || count > static_cast<double>(most)) return false;
    return Skip(static_cast<std::size_t>(count) * SizeOf(property.type));
  }

 private:
  std::string_view bytes_;
  std::size_t offset_;
  bool big_endian_;
};

std::string CutOff(std::size_t readable, const Element& element) {
  return "the file ends after " + std::to_string(readable) + " of " +
         std::to_string(element.count) + " instances of element " + Found(element.name) +
         " that its header states; copy or export it again";
}

hal::Result<void> SkipElement(Walker& walker, const Element& element, std::string_view name) {
  const std::size_t size = element.fixed_size();
  if (size == 0) return {};
  if (element.count > walker.left() / size) {
    return BadByte(name, walker.offset() + walker.left(), CutOff(walker.left() / size, element));
  }
  if (!element.has_list()) {
    walker.Skip(element.count * size);
    return {};
  }
  for (std::size_t i = 0; i < element.count; ++i) {
    for (const Property& property : element.properties) {
      if (!walker.Skip(property)) return BadByte(name, walker.offset(), CutOff(i, element));
    }
  }
  return {};
}

hal::Result<void> ReadVertices(Walker& walker, const Element& vertex,
                               const std::array<std::size_t, 3>& columns, bool big_endian,
                               std::string_view name, double mm_per_unit, PointCloud& cloud) {
  const std::size_t size = vertex.fixed_size();
  if (vertex.count > walker.left() / size) {
    return BadByte(name, walker.offset() + walker.left(), CutOff(walker.left() / size, vertex));
  }
  cloud.points_mm.reserve(vertex.count);
  PointSink sink(cloud, mm_per_unit);
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  if (!vertex.has_list()) {
    std::array<std::size_t, 3> offsets{};
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t p = 0; p < columns[i]; ++p) offsets[i] += SizeOf(vertex.properties[p].type);
    }
    for (std::size_t i = 0; i < vertex.count; ++i, walker.Skip(size)) {
      for (int axis = 0; axis < 3; ++axis) {
        point[axis] = ReadScalar(walker.here() + offsets[axis],
                                 vertex.properties[columns[axis]].type, big_endian);
      }
      sink.Add(point);
    }
    return {};
  }
  for (std::size_t i = 0; i < vertex.count; ++i) {
    for (std::size_t p = 0; p < vertex.properties.size(); ++p) {
      const char* const here = walker.here();
      if (!walker.Skip(vertex.properties[p])) {
        return BadByte(name, walker.offset(), CutOff(i, vertex));
      }
      for (int axis = 0; axis < 3; ++axis) {
        if (columns[axis] == p) {
          point[axis] = ReadScalar(here, vertex.properties[p].type, big_endian);
        }
      }
    }
    sink.Add(point);
  }
  return {};
}

hal::Result<void> ReadAscii(Lines& lines, const Header& header, const Element& vertex,
                            const std::array<std::size_t, 3>& columns, std::string_view name,
                            double mm_per_unit, PointCloud& cloud) {
  for (const Element& element : header.elements) {
    if (&element == &vertex) break;
    if (element.properties.empty()) continue;
    std::string_view line;
    for (std::size_t i = 0; i < element.count;) {
      if (!lines.Next(line)) return BadByte(name, lines.offset(), CutOff(i, element));
      if (!Trimmed(line).empty()) ++i;
    }
  }
  TextTable table;
  table.count = vertex.count;
  table.values = vertex.properties.size();
  table.more_allowed = vertex.has_list();
  for (std::size_t i = 0; i < 3; ++i) {
    table.columns[i] = columns[i];
    for (std::size_t p = 0; p < columns[i]; ++p) {
      if (vertex.properties[p].list_count) {
        return BadLine(name, vertex.line,
                       "a list stands before the coordinates of an ascii vertex; expected x, y and "
                       "z first");
      }
    }
  }
  return ReadTextTable(lines, name, table, mm_per_unit, cloud);
}

}  // namespace

bool IsPly(std::string_view bytes) {
  return bytes.substr(0, 3) == "ply" &&
         (bytes.size() == 3 || bytes[3] == '\n' || bytes[3] == '\r' || IsBlank(bytes[3]));
}

hal::Result<PointCloud> ParsePly(std::string_view bytes, std::string_view name,
                                 double mm_per_unit) {
  Lines lines(bytes);
  const auto header = ParseHeader(lines, name);
  if (!header) return hal::Fail(header.error());
  const Element* vertex = nullptr;
  for (const Element& element : header->elements) {
    if (element.name != "vertex") continue;
    if (vertex) return BadLine(name, element.line, "a second element vertex, expected one");
    vertex = &element;
  }
  if (!vertex) {
    return BadLine(name, lines.number(), "the header has no element vertex, expected one");
  }
  if (vertex->count > kMaxCloudPoints) {
    return BadLine(name, vertex->line,
                   std::to_string(vertex->count) + " vertices, expected at most " +
                       std::to_string(kMaxCloudPoints));
  }
  const auto columns = FindCoordinates(*vertex, name);
  if (!columns) return hal::Fail(columns.error());

  PointCloud cloud;
  cloud.format = "PLY " + header->encoding_name;
  if (header->encoding == Encoding::kAscii) {
    const auto read = ReadAscii(lines, *header, *vertex, *columns, name, mm_per_unit, cloud);
    if (!read) return hal::Fail(read.error());
    return cloud;
  }
  const bool big_endian = header->encoding == Encoding::kBigEndian;
  Walker walker(bytes, lines.offset(), big_endian);
  for (const Element& element : header->elements) {
    const auto done = &element == vertex ? ReadVertices(walker, element, *columns, big_endian, name,
                                                        mm_per_unit, cloud)
                                         : SkipElement(walker, element, name);
    if (!done) return hal::Fail(done.error());
    if (&element == vertex) break;  // what follows, usually faces, is of no interest
  }
  return cloud;
}

}  // namespace bendloop::host
