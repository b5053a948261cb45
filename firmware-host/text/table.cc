// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

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

}  // namespace

void Table::Add(std::vector<Cell> cells) {
  for (Cell& cell : cells) cell.text = Printable(cell.text);
  cells.resize(columns_.size());
  rows_.push_back(std::move(cells));
}

std::string Table::Render(bool colour, std::size_t indent) const {
  std::vector<std::size_t> whole(columns_.size()), rest(columns_.size()), width(columns_.size());
  for (std::size_t c = 0; c < columns_.size(); ++c) {
    for (const auto& row : rows_) {
      if (row.empty()) continue;
      const std::string& text = row[c].text;
      width[c] = std::max(width[c], Width(text));
      whole[c] = std::max(whole[c], Whole(text));
      rest[c] = std::max(rest[c], text.size() - Whole(text));
    }
    if (columns_[c].align == Align::kDecimal) width[c] = whole[c] + rest[c];
    width[c] = std::max(width[c], Width(columns_[c].title));
  }

  std::string out;
  const auto add_line = [&](const auto& cell_text) {
    std::string line, gap = Blanks(indent);
    for (std::size_t c = 0; c < columns_.size(); ++c) {
      const auto [before, text, after] = cell_text(c);
      gap += Blanks(before);
      if (!text.empty()) {
        line += gap + text;  // blanks are only written before something: none trail
        gap.clear();
      }
      gap += Blanks(after + 2);
    }
    out += line + "\n";
  };
  struct Placed {
    std::size_t before;
    std::string text;
    std::size_t after;
  };

  add_line([&](std::size_t c) -> Placed {
    const std::size_t blank = width[c] - Width(columns_[c].title);
    const std::string text = Paint(columns_[c].title, Style::kStrong, colour);
    if (columns_[c].align == Align::kLeft) return {0, text, blank};
    return {blank, text, 0};
  });
  add_line([&](std::size_t c) -> Placed {
    return {0, Paint(std::string(width[c], '-'), Style::kFaint, colour), 0};
  });
  for (const auto& row : rows_) {
    if (row.empty()) {
      out += "\n";
      continue;
    }
    add_line([&](std::size_t c) -> Placed {
      const std::string& text = row[c].text;
      const std::string painted = Paint(text, row[c].style, colour);
      const std::size_t blank = width[c] - std::min(width[c], Width(text));
      switch (columns_[c].align) {
        case Align::kLeft:
          return {0, painted, blank};
        case Align::kRight:
          return {blank, painted, 0};
        case Align::kDecimal: {
          const std::size_t after = std::min(rest[c] - (text.size() - Whole(text)), blank);
          return {blank - after, painted, after};
        }
      }
      return {0, painted, blank};
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
