// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "firmware-host/console/printable.h"

namespace bendloop::host {
namespace {

std::string Print(const char* format, int decimals, double value) {
  if (!std::isfinite(value)) return "-";
  // Half a unit of the last decimal or less would print as -0.000.
  if (std::abs(value) <= 0.5 * std::pow(10.0, -decimals)) value = 0;
  char text[64];
  const int size = std::snprintf(text, sizeof text, format, decimals, value);
  return size < 0 || size >= static_cast<int>(sizeof text) ? "-" : text;
}

// What stands left of the decimal point.
std::size_t Whole(const std::string& text) { return std::min(text.find('.'), text.size()); }

std::string Blanks(std::size_t count) { return std::string(count, ' '); }

// A cell's text and the blanks around it.
struct Placed {
  std::size_t before;
  std::string text;
  std::size_t after;
};

// A column's place on the line, in characters.
struct Extent {
  std::size_t whole = 0;  // left of the decimal point
  std::size_t rest = 0;   // the point and right of it
  std::size_t all = 0;

  Placed Place(const std::string& text, Align align, std::string painted) const {
    const std::size_t blank = all - std::min(all, Width(text));
    switch (align) {
      case Align::kLeft:
        break;
      case Align::kRight:
        return {blank, std::move(painted), 0};
      case Align::kDecimal: {
        const std::size_t after = std::min(rest - (text.size() - Whole(text)), blank);
        return {blank - after, std::move(painted), after};
      }
    }
    return {0, std::move(painted), blank};
  }
};

std::vector<Extent> Extents(const std::vector<Column>& columns,
                            const std::vector<std::vector<Cell>>& rows) {
  std::vector<Extent> extents(columns.size());
  for (std::size_t c = 0; c < columns.size(); ++c) {
    Extent& extent = extents[c];
    for (const auto& row : rows) {
      if (row.empty()) continue;
      const std::string& text = row[c].text;
      extent.all = std::max(extent.all, Width(text));
      extent.whole = std::max(extent.whole, Whole(text));
      extent.rest = std::max(extent.rest, text.size() - Whole(text));
    }
    if (columns[c].align == Align::kDecimal) extent.all = extent.whole + extent.rest;
    extent.all = std::max(extent.all, Width(columns[c].title));
  }
  return extents;
}

}  // namespace

void Table::Add(std::vector<Cell> cells) {
  for (Cell& cell : cells) cell.text = Printable(cell.text);
  cells.resize(columns_.size());
  rows_.push_back(std::move(cells));
}

std::string Table::Render(bool colour, std::size_t indent, std::size_t gap) const {
  const std::vector<Extent> widths = Extents(columns_, rows_);
  std::string out;
  const auto add_line = [&](const auto& cell) {
    std::string line, blanks = Blanks(indent);
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      const auto [before, text, after] = cell(c);
      blanks += Blanks(before);
      if (!text.empty()) {
        line += blanks + text;  // blanks are only written before something: none trail
        blanks.clear();
      }
      blanks += Blanks(after + gap);
    }
    out += line + "\n";
  };
  add_line([&](std::size_t c) {
    const Column& column = columns_[c];
    const Align align = column.align == Align::kLeft ? Align::kLeft : Align::kRight;
    return widths[c].Place(column.title, align, Paint(column.title, Style::kStrong, colour));
  });
  add_line([&](std::size_t c) {
    return Placed{0, Paint(std::string(widths[c].all, '-'), Style::kFaint, colour), 0};
  });
  for (const auto& row : rows_) {
    if (row.empty()) {
      out += "\n";
      continue;
    }
    add_line([&](std::size_t c) {
      const Cell& cell = row[c];
      return widths[c].Place(cell.text, columns_[c].align, Paint(cell.text, cell.style, colour));
    });
  }
  return out;
}

std::string Fixed(double value, int decimals) { return Print("%.*f", decimals, value); }
std::string Signed(double value, int decimals) { return Print("%+.*f", decimals, value); }

int SigmaDecimals(double sigma, int at_most) {
  if (!(sigma > 0) || !std::isfinite(sigma)) return at_most;
  // 0.0996 is 0.10 of two digits.
  const double first = std::floor(std::log10(1.005 * sigma));
  return static_cast<int>(std::clamp(1.0 - first, 0.0, static_cast<double>(at_most)));
}

}  // namespace bendloop::host
