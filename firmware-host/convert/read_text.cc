// SPDX-License-Identifier: Apache-2.0
// Tables of text and CSV, as bending programs, CAD systems and spreadsheets write them.
#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firmware-host/cloud/text.h"
#include "firmware-host/convert/table_rows.h"

namespace bendloop::host {
namespace {

constexpr char kWhitespace = ' ';
constexpr std::size_t kMostColumns = 100;
constexpr std::size_t kNone = kMostColumns;

tl::unexpected<hal::Error> BadLine(std::string_view name, std::size_t line,
                                   const std::string& message) {
  return hal::Fail(hal::ErrorKind::kBadInput,
                   std::string(name) + ":" + std::to_string(line) + ": " + message);
}

// Semicolons, bars and tabs separate cells wherever they stand; commas do unless blanks separate
// numbers with decimal commas.
char DelimiterOf(std::string_view line) {
  for (const char delimiter : {';', '|', '\t'}) {
    if (line.find(delimiter) != std::string_view::npos) return delimiter;
  }
  if (line.find(',') == std::string_view::npos) return kWhitespace;
  std::size_t words = 0;
  for (auto word = NextWord(line); !word.empty(); word = NextWord(line), ++words) {
    if (!NumberFrom(word, true)) return ',';
  }
  return words > 1 ? kWhitespace : ',';
}

// `given` counts the cells that stand there, the empty ones at the end too.
std::vector<std::string_view> Split(std::string_view line, char delimiter, std::size_t& given) {
  std::vector<std::string_view> cells;
  if (delimiter == kWhitespace) {
    for (auto word = NextWord(line); !word.empty() && cells.size() < kMostColumns;
         word = NextWord(line)) {
      cells.push_back(word);
    }
    given = cells.size();
    return cells;
  }
  while (cells.size() < kMostColumns) {
    const std::size_t end = line.find(delimiter);
    std::string_view cell = Trimmed(line.substr(0, end));
    if (cell.size() >= 2 && cell.front() == '"' && cell.back() == '"') {
      cell = Trimmed(cell.substr(1, cell.size() - 2));
    }
    cells.push_back(cell);
    if (end == std::string_view::npos) break;
    line.remove_prefix(end + 1);
  }
  given = cells.size();
  while (!cells.empty() && cells.back().empty()) cells.pop_back();
  return cells;
}

bool IsUnit(std::string_view cell) { return cell.starts_with('[') || cell.starts_with('('); }
bool IsAbsent(std::string_view cell) { return cell.empty() || cell == "-"; }

// "Length [mm]", "length_mm" and "LENGTH" are "length".
std::string ColumnName(std::string_view cell) {
  std::string name = Lower(cell);
  name = name.substr(0, name.find_first_of("[("));
  while (!name.empty() && name.back() == ' ') name.pop_back();
  for (const std::string_view unit : {"_mm", "_deg", "_m", "_in"}) {
    if (name.ends_with(unit)) name.resize(name.size() - unit.size());
  }
  std::replace(name.begin(), name.end(), ' ', '_');
  return name;
}

struct Columns {
  TableKind kind = TableKind::kLra;
  std::array<std::size_t, 3> values = {0, 1, 2};
  std::size_t radius = 3;
  std::size_t width = 0;       // cells of the header, or of the first row
  std::size_t width_line = 0;  // where that stands
};

std::size_t Find(const std::vector<std::string>& names,
                 std::initializer_list<std::string_view> aliases) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(aliases.begin(), aliases.end(), names[i]) != aliases.end()) return i;
  }
  return kNone;
}

std::optional<Columns> ColumnsFrom(const std::vector<std::string_view>& cells,
                                   std::optional<TableKind> from) {
  std::vector<std::string> names;
  for (const auto cell : cells) {
    if (!IsUnit(cell)) names.push_back(ColumnName(cell));
  }
  const std::array<std::size_t, 3> xyz = {Find(names, {"x"}), Find(names, {"y"}),
                                          Find(names, {"z"})};
  const std::array<std::size_t, 3> lra = {Find(names, {"length", "l", "straight"}),
                                          Find(names, {"rotation", "r", "rot"}),
                                          Find(names, {"angle", "a", "bend", "bend_angle"})};
  const std::array<std::size_t, 3> ybc = {Find(names, {"y", "feed"}), Find(names, {"b", "plane"}),
                                          Find(names, {"c"})};
  const auto complete = [](const std::array<std::size_t, 3>& found) {
    return std::count(found.begin(), found.end(), kNone) == 0;
  };
  Columns columns;
  columns.width = names.size();
  columns.radius = Find(names, {"bend_radius", "radius", "clr", "bendradius"});
  if (complete(xyz)) {
    columns.kind = TableKind::kXyz;
    columns.values = xyz;
    if (columns.radius == kNone) columns.radius = Find(names, {"r"});
  } else if (complete(lra)) {
    columns.kind = TableKind::kLra;
    columns.values = lra;
  } else if (complete(ybc)) {
    columns.kind = TableKind::kYbc;
    columns.values = ybc;
  } else {
    return std::nullopt;
  }
  // Length, rotation and angle are also the columns of a machine's table and of a pose.
  if (from && *from != columns.kind) {
    const bool same_columns = *from != TableKind::kXyz && columns.kind == TableKind::kLra;
    if (!same_columns) return std::nullopt;
    columns.kind = *from;
  }
  return columns;
}

bool SaysMillimetres(std::string_view header) {
  const std::string lower = Lower(header);
  return lower.find("_mm") != std::string::npos || lower.find("[mm]") != std::string::npos ||
         lower.find("(mm)") != std::string::npos;
}

class Reader {
 public:
  Reader(std::string_view name, const TableReadOptions& options)
      : name_(name), options_(options), mm_per_unit_(MillimetresPer(options.units)) {
    table_.style = options.style;
    if (options.from) table_.kind = *options.from;
  }

  hal::Result<RawTable> Read(std::string_view text) {
    Lines lines(text);
    std::string_view line;
    while (lines.Next(line)) {
      line = Trimmed(line);
      if (line.empty() || line.starts_with('#') || line.starts_with("//")) continue;
      if (line.find_first_not_of("-+|= \t") == std::string_view::npos) continue;  // a drawn rule
      line_ = lines.number();
      const auto done = ReadLine(line);
      if (!done) return hal::Fail(done.error());
    }
    if (table_.rows.empty()) return Bad("the text ends without a row of numbers");
    if (table_.kind == TableKind::kPose && !(have_position_ && have_orientation_)) {
      return Bad(std::string("a pose without a line \"") +
                 (have_position_ ? "orientation_wxyz w x y z" : "position_mm x y z") +
                 "\" before its rows");
    }
    return table_;
  }

 private:
  tl::unexpected<hal::Error> Bad(const std::string& message) const {
    return BadLine(name_, line_, message);
  }

  hal::Result<void> ReadLine(std::string_view line) {
    if (table_.rows.size() == kMaxTableRows) {
      return Bad("more than " + std::to_string(kMaxTableRows) + " rows, expected one tube");
    }
    // A title may hold any character, so each line of words decides for itself.
    const char delimiter = have_numbers_ ? delimiter_ : DelimiterOf(line);
    std::size_t given = 0;
    const auto cells = Split(line, delimiter, given);
    if (cells.empty()) return {};
    if (!have_numbers_) {
      const std::string key = Lower(cells[0]);
      if (key == "position_mm" || key == "orientation_wxyz" || key == "pipe_radius_mm") {
        return ReadKey(key, cells);
      }
      if (!NumberFrom(cells[0], delimiter != ',') && !IsAbsent(cells[0]))
        return ReadHeader(line, cells);
    }
    if (!have_numbers_) {
      auto started = Start(line, delimiter, given, cells.size());
      if (!started) return started;
    }
    if (auto fits = CheckWidth(given, cells.size()); !fits) return fits;
    return ReadRow(cells);
  }

  hal::Result<void> ReadHeader(std::string_view line, const std::vector<std::string_view>& cells) {
    if (columns_) return Bad("found " + Found(line) + ", expected numbers under the column names");
    columns_ = ColumnsFrom(cells, options_.from);
    if (!columns_) {
      return Bad("found " + Found(line) + ", expected column names " + ExpectedNames() +
                 " or numbers");
    }
    columns_->width_line = line_;
    if (options_.units != Units::kMillimetres && SaysMillimetres(line)) {
      return hal::Fail(hal::ErrorKind::kUsage, std::string(name_) + ":" + std::to_string(line_) +
                                                   ": the columns " + Found(line) +
                                                   " are in mm; expected --units mm");
    }
    if (table_.kind == TableKind::kPose && columns_->kind != TableKind::kPose && !options_.from &&
        columns_->kind != TableKind::kLra) {
      return Bad("found " + Found(line) + ", expected length rotation angle in a pose");
    }
    if (table_.kind != TableKind::kPose) table_.kind = columns_->kind;
    return {};
  }

  std::string ExpectedNames() const {
    if (options_.from == TableKind::kXyz) return "x y z";
    if (options_.from == TableKind::kYbc) return "y b c";
    if (options_.from) return "length rotation angle";
    return "x y z, length rotation angle, or y b c";
  }

  hal::Result<void> ReadKey(const std::string& key, const std::vector<std::string_view>& cells) {
    const std::size_t count = key == "pipe_radius_mm" ? 1 : key == "position_mm" ? 3 : 4;
    // A pose holds an LRA program.
    const bool lra_of_it = options_.from == TableKind::kLra;
    if (options_.from && *options_.from != TableKind::kPose && !lra_of_it) {
      return Bad("found " + Found(key) + " of a pose, expected a table of " +
                 std::string(Name(*options_.from)));
    }
    if (options_.units != Units::kMillimetres && key != "orientation_wxyz") {
      return hal::Fail(hal::ErrorKind::kUsage, std::string(name_) + ":" + std::to_string(line_) +
                                                   ": " + key + " is in mm; expected --units mm");
    }
    std::array<double, 4> values{};
    for (std::size_t i = 0; i < count; ++i) {
      const auto value = i + 1 < cells.size() ? NumberFrom(cells[i + 1], true) : std::nullopt;
      if (!value || !std::isfinite(*value) || cells.size() > count + 1) {
        return Bad(key + " has " + std::to_string(cells.size() - 1) + " value(s), expected " +
                   std::to_string(count) + " number(s)");
      }
      values[i] = *value;
    }
    if (key == "pipe_radius_mm") {
      table_.pipe_radius_mm = values[0];
    } else if (key == "position_mm") {
      table_.X_WT.position_mm = {values[0], values[1], values[2]};
      have_position_ = true;
    } else {
      const Eigen::Quaterniond q(values[0], values[1], values[2], values[3]);
      if (!(std::abs(q.norm() - 1) < 1e-3)) {
        return Bad("orientation_wxyz has length " + std::to_string(q.norm()) +
                   ", expected a unit quaternion");
      }
      table_.X_WT.orientation = q.normalized();
      have_orientation_ = true;
    }
    if (!lra_of_it) table_.kind = TableKind::kPose;
    return {};
  }

  // At the first line of numbers.
  hal::Result<void> Start(std::string_view line, char delimiter, std::size_t given,
                          std::size_t cells) {
    have_numbers_ = true;
    delimiter_ = delimiter;
    if (columns_) return {};
    if (!options_.from && table_.kind != TableKind::kPose) {
      return Bad("found " + Found(line) +
                 " without column names; say --from xyz, lra, ybc or pose, or name the columns "
                 "in a line before");
    }
    if (cells > 4) {
      return Bad(std::to_string(cells) +
                 " columns without names, expected three and a bend radius; name the columns in a "
                 "line before");
    }
    columns_.emplace();
    columns_->kind = table_.kind;
    columns_->width = std::max<std::size_t>(std::min<std::size_t>(given, 4), cells);
    columns_->width_line = line_;
    return {};
  }

  // A row with another number of cells than the names or the first row is misread sooner or later:
  // most often a decimal comma has become two cells.
  hal::Result<void> CheckWidth(std::size_t given, std::size_t cells) {
    const std::size_t width = columns_->width;
    if (cells > width) return WrongWidth(cells);
    if (given >= width) return {};
    // The last row may end after its length, and needs no radius. Between commas the second could
    // be the half of a number.
    const bool ends_early = given == columns_->values[0] + 1;
    const bool no_radius = delimiter_ != ',' && cells > *std::max_element(columns_->values.begin(),
                                                                          columns_->values.end());
    if (table_.kind == TableKind::kXyz || !(ends_early || no_radius)) return WrongWidth(given);
    if (!pending_ && no_radius) short_row_ = WrongWidth(given).value();
    return {};
  }

  tl::unexpected<hal::Error> WrongWidth(std::size_t found) const {
    std::string message = "found " + std::to_string(found) + " cells, expected " +
                          std::to_string(columns_->width) + " as in line " +
                          std::to_string(columns_->width_line);
    if (delimiter_ == ',') {
      message += "; decimal commas need semicolons, tabs or blanks between the cells";
    } else if (found < columns_->width) {
      message += "; an empty cell is -";
    }
    return Bad(message);
  }

  hal::Result<void> ReadRow(const std::vector<std::string_view>& cells) {
    // A row that ends early, as last rows do, was not the last.
    if (pending_) return hal::Fail(*pending_);
    pending_ = std::exchange(short_row_, std::nullopt);
    const bool points = table_.kind == TableKind::kXyz;
    TableRow row;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t column = columns_->values[i];
      const std::string_view cell = column < cells.size() ? cells[column] : std::string_view();
      if (IsAbsent(cell) && i > 0 && !points) {
        // Nothing to rotate against in the first row, nothing to do at all after the last bend.
        if (i == 2 || !table_.rows.empty()) pending_ = Missing(i);
        continue;
      }
      const auto value = NumberFrom(cell, delimiter_ != ',');
      if (!value || !std::isfinite(*value)) {
        return Bad("found " + Found(cell) + " as " + ValueName(i) + ", expected a number");
      }
      row.values[i] = *value * (i == 0 || points ? mm_per_unit_ : 1.0);
    }
    if (columns_->radius < cells.size() && !IsAbsent(cells[columns_->radius])) {
      const std::string_view cell = cells[columns_->radius];
      const auto radius = NumberFrom(cell, delimiter_ != ',');
      if (!radius || !std::isfinite(*radius)) {
        return Bad("found " + Found(cell) + " as bend radius, expected a number or -");
      }
      row.bend_radius_mm = *radius * mm_per_unit_;
    }
    if (!points) {
      if (auto bend = CheckBend(row); !bend) return bend;
    }
    table_.rows.push_back(row);
    return {};
  }

  // A bend radius without a bend: "100,5,0,90" is 100.5, 0 and 90 with decimal commas. Only a last
  // row, which has no bend, may repeat the tool's.
  hal::Result<void> CheckBend(const TableRow& row) {
    if (row.values[2] != 0 || row.bend_radius_mm.value_or(0) == 0) return {};
    std::string message =
        "found a bend radius beside " + ValueName(2) + " 0, expected a bend, or -";
    if (delimiter_ == ',')
      message += "; decimal commas need semicolons, tabs or blanks between the cells";
    const hal::Error error = Bad(message).value();
    // Nor does anything rotate in a last row.
    if (delimiter_ == ',' && row.values[1] != 0) return hal::Fail(error);
    if (!pending_) pending_ = error;
    return {};
  }

  hal::Error Missing(std::size_t value) const {
    return Bad("found no " + ValueName(value) + ", expected a number").value();
  }

  std::string ValueName(std::size_t i) const {
    static constexpr const char* kNames[3][3] = {
        {"x", "y", "z"}, {"length", "rotation", "angle"}, {"y", "b", "c"}};
    const int kind = table_.kind == TableKind::kXyz ? 0 : table_.kind == TableKind::kYbc ? 2 : 1;
    return kNames[kind][i];
  }

  std::string_view name_;
  const TableReadOptions& options_;
  double mm_per_unit_;
  RawTable table_;
  std::optional<Columns> columns_;
  std::optional<hal::Error> pending_;    // wrong unless this row was the last
  std::optional<hal::Error> short_row_;  // of the row that is read now
  char delimiter_ = kWhitespace;
  std::size_t line_ = 1;
  bool have_numbers_ = false;
  bool have_position_ = false;
  bool have_orientation_ = false;
};

}  // namespace

hal::Result<RawTable> ReadTextTableRows(std::string_view text, std::string_view name,
                                        const TableReadOptions& options) {
  return Reader(name, options).Read(text);
}

}  // namespace bendloop::host
