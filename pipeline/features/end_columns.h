// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_lines.h"
#include "pipeline/features/even_table.h"

namespace bendloop::pipeline {

// A narrow part of the turn about an end.
struct EndColumn {
  double around_rad = 0;  // of its middle
  double last_mm = 0;     // where its samples stop
  double mean_gap_mm = 0;
  std::optional<LineBracket> lines;  // of laser lines
};

// What a column says of a border by how far, in mean gaps, it lies beyond the column's last sample:
// the logarithm of the likelihood, from a table.
class EndStops {
 public:
  // `gaps`: between samples. `smear`: 1 sigma by which noise displaces a sample. Both in mean gaps.
  // Columns that the same laser lines cross have the same gaps and tell of their length once,
  // together; of the longest each. `hidden`: what a column says that stops before it by however
  // much, as one does that something hides; 0: that denies the border.
  EndStops(std::vector<double> gaps, double smear, double columns_of_line, double hidden = 0);
  // The sum over several columns.
  double Sum(std::span<const double> beyond) const { return table_.Sum(beyond); }
  // The same of a plane (EndSide) over columns.
  double Sum(const PlaneLanes& columns, const double* x) const {
    return table_.Sum(columns, x, 0.0);
  }

 private:
  EvenTable table_;
};

// All samples about an end in columns, whatever pass they came in.
class EndColumns {
 public:
  EndColumns(std::span<const EndSample> samples, double window_mm, double smear_mm);

  const std::vector<EndColumn>& seen() const { return seen_; }
  double width_rad() const;
  bool AreEnough() const;
  double MeanGapMm() const;
  EndStops MakeStops(double smear_mm, double hidden = 0) const {
    return {gaps_, smear_mm / MeanGapMm(), columns_of_line_, hidden};
  }

 private:
  void Take(std::size_t k, double window_mm, double smear_mm, std::vector<double>& at);
  void Smooth();

  std::size_t count_ = 0;
  std::vector<EndColumn> seen_;
  std::vector<double> gaps_;  // in mean gaps
  double columns_of_line_ = 1;
};

}  // namespace bendloop::pipeline
