// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <initializer_list>
#include <string>
#include <vector>

#include "firmware-host/text/style.h"

namespace bendloop::host {

enum class Align { kLeft, kRight, kDecimal };

struct Column {
  std::string title;
  Align align = Align::kLeft;
};

struct Cell {
  std::string text;
  Style style = Style::kPlain;

  Cell(std::string t = {}, Style s = Style::kPlain) : text(std::move(t)), style(s) {}  // NOLINT
  Cell(const char* t) : text(t) {}                                                     // NOLINT
};

// Columns that line up: words to the left, numbers at their decimal points.
class Table {
 public:
  explicit Table(std::vector<Column> columns) : columns_(std::move(columns)) {}

  // Missing cells are empty.
  void Add(std::vector<Cell> cells);
  // A blank line between groups of rows.
  void AddGap() { rows_.emplace_back(); }

  // Title line, a rule, the rows; every line ends with '\n' and without trailing blanks.
  // `gap` blanks stand between columns.
  std::string Render(bool colour, std::size_t indent = 2, std::size_t gap = 2) const;

 private:
  std::vector<Column> columns_;
  std::vector<std::vector<Cell>> rows_;
};

// A number with a fixed count of decimals, "-" when it is not finite, never "-0.000".
std::string Fixed(double value, int decimals);
// The same with a sign: "+0.120".
std::string Signed(double value, int decimals);
// Decimals that show two digits of `sigma`, from 0 to `at_most`; a value has a meaning to these.
// `at_most` when there is no sigma.
int SigmaDecimals(double sigma, int at_most);

}  // namespace bendloop::host
