// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_table.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace bendloop::bench {
namespace {

std::size_t Width(const std::string& text) {  // of UTF-8
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

std::string GoalText(const Row& row) {
  if (!row.goal) return "-";
  if (row.goal_at_least) return Number(*row.goal_at_least) + " to " + Number(*row.goal);
  return Number(*row.goal);
}

}  // namespace

std::string Number(double value) {
  const double size = std::abs(value);
  const int decimals = size == 0 || size >= 1000 || value == std::round(value) ? 0
                       : size >= 100                                           ? 1
                       : size >= 1                                             ? 2
                                                                               : 4;
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

std::string Verdict(const Row& row) {
  if (!row.first_bar && !row.goal) return "-";
  const auto reaches = [&row](const std::optional<double>& target) {
    return target && (row.more_is_better ? row.value >= *target : row.value <= *target);
  };
  if (reaches(row.goal) && (!row.goal_at_least || row.value >= *row.goal_at_least)) return "goal";
  return reaches(row.first_bar) ? "required" : "not reached";
}

void PrintMarkdown(std::ostream& out, const std::string& title,
                   const std::vector<std::vector<std::string>>& lines,
                   const std::vector<bool>& is_number) {
  std::vector<std::size_t> width(is_number.size(), 0);
  for (const auto& cells : lines) {
    for (std::size_t c = 0; c < cells.size(); ++c) width[c] = std::max(width[c], Width(cells[c]));
  }
  if (!title.empty()) out << "### " << title << "\n\n";
  for (std::size_t i = 0; i < lines.size(); ++i) {
    out << "|";
    for (std::size_t c = 0; c < width.size(); ++c) {
      const std::string pad(width[c] - Width(lines[i][c]), ' ');
      out << ' ' << (is_number[c] ? pad + lines[i][c] : lines[i][c] + pad) << " |";
    }
    out << '\n';
    if (i > 0) continue;
    out << "|";
    for (std::size_t c = 0; c < width.size(); ++c) {
      const std::string line(width[c], '-');
      out << ' ' << (is_number[c] ? line.substr(1) + ":" : line) << " |";
    }
    out << '\n';
  }
  out << '\n';
}

void PrintTable(std::ostream& out, const std::string& title, const std::vector<Row>& rows) {
  std::vector<std::vector<std::string>> lines = {
      {"what", "measured", "required", "goal", "reached", "note"}};
  for (const Row& row : rows) {
    lines.push_back({row.what, Number(row.value) + (row.unit.empty() ? "" : " " + row.unit),
                     row.first_bar ? Number(*row.first_bar) : "-", GoalText(row), Verdict(row),
                     row.note});
  }
  PrintMarkdown(out, title, lines, {false, true, true, true, false, false});
}

nlohmann::json ToJson(const std::vector<Row>& rows) {
  nlohmann::json list = nlohmann::json::array();
  for (const Row& row : rows) {
    nlohmann::json entry = {{"what", row.what}, {"value", row.value}, {"unit", row.unit}};
    if (row.first_bar) entry["first_bar"] = *row.first_bar;
    if (row.goal) entry["goal"] = *row.goal;
    entry["reached"] = Verdict(row);
    if (!row.note.empty()) entry["note"] = row.note;
    list.push_back(std::move(entry));
  }
  return list;
}

}  // namespace bendloop::bench
