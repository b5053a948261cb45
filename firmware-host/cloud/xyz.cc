// SPDX-License-Identifier: Apache-2.0
// Text with one point a line: XYZ, CSV, TXT, ASC, PTS. There is no standard, so the first line of
// numbers decides the delimiter, and a header line, if any, decides the columns.
#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "firmware-host/cloud/formats.h"
#include "firmware-host/cloud/text.h"

namespace bendloop::host {
namespace {

constexpr char kWhitespace = ' ';  // any run of blanks and tabs
constexpr std::size_t kMostColumns = 1000;

std::string_view Unquoted(std::string_view cell) {
  cell = Trimmed(cell);
  if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') {
    cell = Trimmed(cell.substr(1, cell.size() - 2));
  }
  return cell;
}

// Takes the next cell from the front of `line`; `done` is set with the last one.
std::string_view NextCell(std::string_view& line, char delimiter, bool& done) {
  if (delimiter == kWhitespace) {
    const std::string_view word = NextWord(line);
    done = word.empty();
    return word;
  }
  const std::size_t end = line.find(delimiter);
  const std::string_view cell = line.substr(0, end);
  done = end == std::string_view::npos;
  line.remove_prefix(done ? line.size() : end + 1);
  return cell;
}

std::vector<std::string_view> Split(std::string_view line, char delimiter) {
  std::vector<std::string_view> cells;
  line = Trimmed(line);
  bool done = false;
  while (!done && cells.size() < kMostColumns) {
    const std::string_view cell = NextCell(line, delimiter, done);
    if (delimiter != kWhitespace || !cell.empty()) cells.push_back(Unquoted(cell));
  }
  // A delimiter at the end of the line ends the last cell and begins none.
  if (delimiter != kWhitespace && cells.size() > 1 && cells.back().empty()) cells.pop_back();
  return cells;
}

bool IsComment(std::string_view line) {
  return line.substr(0, 1) == "#" || line.substr(0, 1) == "%" || line.substr(0, 2) == "//";
}

// At least three numbers when split so.
bool ReadsAsPoint(std::string_view line, char delimiter) {
  const auto cells = Split(line, delimiter);
  if (cells.size() < 3) return false;
  const auto is_number = [&](std::string_view cell) {
    return NumberFrom(cell, delimiter != ',').has_value();
  };
  // Several tabs in a row align columns more often than they leave cells empty.
  if (delimiter == '\t' && std::count(cells.begin(), cells.end(), "") > 0) return false;
  return std::count_if(cells.begin(), cells.end(), is_number) >= 3;
}

std::optional<char> DelimiterOf(std::string_view line) {
  // Blanks come before the comma: "1,5 2,5 3,5" has decimal commas, "1.5, 2.5, 3.5" has cells that
  // blanks do not split into numbers.
  for (const char delimiter : {';', '|', '\t', kWhitespace, ','}) {
    const bool present = delimiter == kWhitespace || line.find(delimiter) != std::string_view::npos;
    if (present && ReadsAsPoint(line, delimiter)) return delimiter;
  }
  return std::nullopt;
}

// "X [mm]", "x_mm", "X(mm)" and "Points:0" name x.
int AxisOf(std::string_view cell) {
  const std::string name = Lower(Unquoted(cell));
  const std::size_t end = name.find_first_of(" [(/_:,");
  const std::string head = name.substr(0, end);
  if (head.size() == 1 && head[0] >= 'x' && head[0] <= 'z') return head[0] - 'x';
  if (name.size() == 8 && (name.starts_with("points:") || name.starts_with("points_")) &&
      name[7] >= '0' && name[7] <= '2') {
    return name[7] - '0';
  }
  return -1;
}

// The unit in a column name such as "X [mm]"; 0: none.
double UnitOf(std::string_view cell) {
  const std::string name = Lower(cell);
  const std::size_t end = name.find_first_of("[(_");
  if (end == std::string::npos) return 0;
  std::string unit = name.substr(end + 1);
  unit = unit.substr(0, unit.find_first_of("])"));
  if (unit == "mm") return 1;
  if (unit == "m") return 1000;
  if (unit == "in" || unit == "inch") return 25.4;
  return 0;
}

struct Columns {
  std::array<std::size_t, 3> of_axis = {0, 1, 2};
  double unit_mm = 0;     // stated by the header; 0: not stated
  std::size_t count = 3;  // that the header names
};

std::optional<Columns> ColumnsFrom(const std::vector<std::string_view>& cells) {
  Columns columns;
  columns.count = cells.size();
  std::array<int, 3> found{};
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const int axis = AxisOf(cells[i]);
    if (axis < 0) continue;
    if (found[axis]++ > 0) return std::nullopt;
    columns.of_axis[axis] = i;
    if (UnitOf(cells[i]) > 0) columns.unit_mm = UnitOf(cells[i]);
  }
  if (found != std::array<int, 3>{1, 1, 1}) return std::nullopt;
  return columns;
}

// Columns named by a header line over lines of `width` cells.
std::optional<Columns> ParseNames(std::string_view header, char delimiter, std::size_t width) {
  while (!header.empty() &&
         (header.front() == '#' || header.front() == '%' || header.front() == '/')) {
    header.remove_prefix(1);
  }
  if (delimiter != kWhitespace) {
    const auto columns = ColumnsFrom(Split(header, delimiter));
    if (columns) return columns;
  }
  // Headers are not always written with the delimiter of the numbers below them.
  std::string blanks(header);
  std::replace_if(
      blanks.begin(), blanks.end(),
      [](char c) { return c == ',' || c == ';' || c == '|' || c == '\t'; }, ' ');
  std::vector<std::string_view> cells;
  double unit_mm = 0;
  for (const auto cell : Split(blanks, kWhitespace)) {
    if (cell.front() != '[' && cell.front() != '(') {
      cells.push_back(cell);
    } else if (UnitOf(cell) > 0) {
      unit_mm = UnitOf(cell);
    }
  }
  if (cells.size() > width) return std::nullopt;
  auto columns = ColumnsFrom(cells);
  if (columns && unit_mm > 0) columns->unit_mm = unit_mm;
  if (columns && *std::max_element(columns->of_axis.begin(), columns->of_axis.end()) >= width) {
    return std::nullopt;
  }
  return columns;
}

bool EndsWithDelimiter(std::string_view line, char delimiter) {
  const std::size_t last = line.rfind(delimiter);
  return last != std::string_view::npos && Trimmed(line.substr(last + 1)).empty();
}

// Cells of a line; a delimiter at its end begins none, and a comment at its end is none.
std::size_t CountCells(std::string_view line, char delimiter) {
  if (delimiter != kWhitespace) {
    const auto delimiters = std::count(line.begin(), line.end(), delimiter);
    return static_cast<std::size_t>(delimiters) + (EndsWithDelimiter(line, delimiter) ? 0 : 1);
  }
  std::size_t cells = 0;
  for (auto word = NextWord(line); !word.empty() && !IsComment(word); word = NextWord(line)) {
    ++cells;
  }
  return cells;
}

// What stands before the first point.
struct Layout {
  char delimiter = kWhitespace;
  Columns columns;
  bool named = false;
  std::size_t width = 0;       // cells of every row
  std::size_t width_line = 0;  // the header's or the first row's
  std::optional<std::size_t> stated_points;
  std::size_t stated_line = 0;
  std::string_view first;  // the first line of numbers, already taken from the Lines
};

// `where` is the line that had been expected to be a point.
tl::unexpected<hal::Error> NoPoint(std::string_view name, std::size_t where,
                                   std::string_view line) {
  return BadLine(
      name, where,
      "found " + Found(line) +
          ", expected three numbers, or a header that names x, y and z (comments begin with "
          "#, % or //)");
}

bool NamesColumns(std::string_view header) {
  const auto names = [&](char delimiter) {
    return ParseNames(header, delimiter, kMostColumns).has_value();
  };
  return names(kWhitespace) || names(';') || names(',') || names('\t') || names('|');
}

hal::Result<Layout> FindLayout(Lines& lines, std::string_view name) {
  Layout layout;
  std::string_view line;
  std::string_view comment;  // the last one, which may name the columns
  std::string_view header;
  std::size_t header_line = 0;
  while (lines.Next(line)) {
    line = Trimmed(line);
    if (line.empty()) continue;
    if (IsComment(line)) {
      if (!ParseNames(comment, kWhitespace, kMostColumns)) comment = line;
      continue;
    }
    const auto delimiter = DelimiterOf(line);
    if (!delimiter) {
      const auto count = CountFrom(line);
      if (count && !layout.stated_points) {
        layout.stated_points = count;
        layout.stated_line = lines.number();
      } else if (header.empty()) {
        header = line;
        header_line = lines.number();
      } else if (NamesColumns(header)) {
        return NoPoint(name, lines.number(), line);
      } else {
        return NoPoint(name, header_line, header);
      }
      continue;
    }
    layout.delimiter = *delimiter;
    layout.width = CountCells(line, *delimiter);
    layout.width_line = lines.number();
    layout.first = line;
    const auto names = ParseNames(header.empty() ? comment : header, *delimiter, layout.width);
    if (!header.empty() && !names) return NoPoint(name, header_line, header);
    if (names) {
      layout.columns = *names;
      layout.named = true;
    }
    // A comment may name the first columns only.
    if (names && !header.empty()) {
      layout.width = names->count;
      layout.width_line = header_line;
    }
    return layout;
  }
  if (!header.empty() && !NamesColumns(header)) return NoPoint(name, header_line, header);
  return BadLine(name, std::max<std::size_t>(1, lines.number()),
                 "the text ends without a point, expected lines of three numbers");
}

class RowReader {
 public:
  explicit RowReader(const Layout& layout) : layout_(layout) {
    for (const std::size_t column : layout.columns.of_axis) last_ = std::max(last_, column);
  }

  // Empty: a point. Otherwise what is wrong.
  std::optional<std::string> Read(std::string_view line, Eigen::Vector3d& point) const {
    const std::string_view whole = line;
    bool done = false;
    std::size_t column = 0;
    for (; column <= last_ && !done; ++column) {
      std::string_view cell = NextCell(line, layout_.delimiter, done);
      if (layout_.delimiter == kWhitespace && done) break;
      for (int axis = 0; axis < 3; ++axis) {
        if (layout_.columns.of_axis[axis] != column) continue;
        auto value = NumberFrom(cell, layout_.delimiter != ',');
        if (!value) value = NumberFrom(Unquoted(cell), layout_.delimiter != ',');
        if (!value) {
          return "found " + Found(Trimmed(cell)) + " as " + "xyz"[axis] + ", expected a number";
        }
        point[axis] = *value;
      }
    }
    // What is left of the line is counted where it stands.
    const std::size_t cells = done ? column : column + CountCells(line, layout_.delimiter);
    if (column > last_ && cells == layout_.width) return std::nullopt;
    return WrongWidth(whole);
  }

 private:
  std::optional<std::string> WrongWidth(std::string_view line) const {
    const std::size_t cells = CountCells(line, layout_.delimiter);
    // An empty cell at the end stands there all the same.
    if (cells + 1 == layout_.width && layout_.delimiter != kWhitespace && cells > last_ &&
        EndsWithDelimiter(line, layout_.delimiter)) {
      return std::nullopt;
    }
    if (cells == layout_.width) return std::nullopt;
    std::string wrong = "found " + std::to_string(cells) + " column(s) in " + Found(line) +
                        ", expected " + std::to_string(layout_.width) + " as in line " +
                        std::to_string(layout_.width_line);
    if (layout_.delimiter == ',' && cells > layout_.width) {
      wrong += "; decimal commas need semicolons, tabs or blanks between the columns";
    }
    return wrong;
  }

  const Layout& layout_;
  std::size_t last_ = 0;
};

std::string DelimiterName(char delimiter) {
  switch (delimiter) {
    case kWhitespace:
      return "blanks";
    case '\t':
      return "tabs";
    case ',':
      return "commas";
    case ';':
      return "semicolons";
    default:
      return "bars";
  }
}

// A first column that counts the lines is usually a point number that a header would have named.
bool CountsLines(const PointCloud& cloud, double mm_per_unit) {
  const std::size_t n = std::min<std::size_t>(cloud.points_mm.size(), 100);
  if (n < 10) return false;
  for (std::size_t i = 1; i < n; ++i) {
    const double step = (cloud.points_mm[i].x() - cloud.points_mm[i - 1].x()) / mm_per_unit;
    if (std::abs(step - 1.0) > 1e-9) return false;
  }
  return true;
}

}  // namespace

hal::Result<PointCloud> ParseXyz(std::string_view bytes, std::string_view name,
                                 double mm_per_unit) {
  Lines lines(bytes);
  const auto layout = FindLayout(lines, name);
  if (!layout) return hal::Fail(layout.error());
  PointCloud cloud;
  cloud.format = "text, columns separated by " + DelimiterName(layout->delimiter);
  cloud.points_mm.reserve(
      std::min(kMaxCloudPoints, lines.rest().size() / (layout->first.size() + 1) + 1));
  PointSink sink(cloud, mm_per_unit);
  const RowReader reader(*layout);
  std::string_view line = layout->first;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  const std::size_t first_line = lines.number();
  // Six columns without names may be three numbers with decimal commas, until one has a point.
  bool may_be_halves = layout->delimiter == ',' && !layout->named && layout->width == 6;
  do {
    // Most lines are points: ask for blanks and comments only when they are not.
    if (const auto wrong = reader.Read(line, point)) {
      const std::string_view trimmed = Trimmed(line);
      if (trimmed.empty() || IsComment(trimmed)) continue;
      const auto again = reader.Read(trimmed, point);
      if (again) return BadLine(name, lines.number(), *again);
    }
    if (sink.added() == kMaxCloudPoints) {
      return BadLine(name, lines.number(),
                     "more than " + std::to_string(kMaxCloudPoints) + " points, expected fewer");
    }
    sink.Add(point);
    if (may_be_halves) may_be_halves = line.find_first_of(".eE") == std::string_view::npos;
  } while (lines.Next(line));
  if (may_be_halves) {
    return BadLine(
        name, first_line,
        "six columns of whole numbers: three numbers with decimal commas? Separate those "
        "by semicolons, tabs or blanks, or name the columns in a header line");
  }

  if (layout->stated_points && *layout->stated_points > sink.added()) {
    return BadLine(name, lines.number(),
                   "the file ends after " + std::to_string(sink.added()) + " of " +
                       std::to_string(*layout->stated_points) + " points that line " +
                       std::to_string(layout->stated_line) + " states; copy or export it again");
  }
  if (layout->columns.unit_mm > 0 && layout->columns.unit_mm != mm_per_unit) {
    const double stated = layout->columns.unit_mm;
    const std::string unit = stated == 1 ? "mm" : stated == 1000 ? "m" : "in";
    cloud.warnings.push_back("the column names say " + unit +
                             ", the coordinates were read as something else; check --units");
  }
  if (!layout->named && layout->width > 3 && CountsLines(cloud, mm_per_unit)) {
    cloud.warnings.push_back(
        "the first column counts the lines but was taken as x; name the columns in a header line "
        "if it is a point number");
  }
  return cloud;
}

}  // namespace bendloop::host
