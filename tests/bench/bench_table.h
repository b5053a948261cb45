// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace bendloop::bench {

// A figure beside what it should be.
struct Row {
  std::string what;
  double value = 0;
  std::string unit{};
  // A value no larger than these reaches them; empty: reported only.
  std::optional<double> first_bar{};
  std::optional<double> goal{};
  std::optional<double> goal_at_least{};  // where too small is wrong too
  bool more_is_better = false;
  std::string note{};
};

// "goal", "required", "not reached", "-".
std::string Verdict(const Row& row);

// Markdown whose columns line up; the first line is the head. Columns of numbers are set right.
// With a title it begins a section.
void PrintMarkdown(std::ostream& out, const std::string& title,
                   const std::vector<std::vector<std::string>>& lines,
                   const std::vector<bool>& is_number);
void PrintTable(std::ostream& out, const std::string& title, const std::vector<Row>& rows);
nlohmann::json ToJson(const std::vector<Row>& rows);

// At most four significant digits, nothing in powers of ten.
std::string Number(double value);

}  // namespace bendloop::bench
