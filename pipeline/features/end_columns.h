// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
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

// How often columns stop so far before a border, in mean gaps, by the gaps between their samples.
class GapsBeforeBorder {
 public:
  GapsBeforeBorder() = default;
  explicit GapsBeforeBorder(std::vector<double> gaps);
  // Minus the logarithm of how many stop as far before it or farther: of many that do not know of
  // each other the mean is 1, the variance, too, and the least of n 1 / n.
  double Rarity(double missing) const;

 private:
  std::vector<double> gaps_, longer_;  // in their order, and the sum of each and those after it
};

// What a column says of a border by how far, in mean gaps, it lies beyond the column's last sample:
// the logarithm of the likelihood, from a table.
class EndStops {
 public:
  // `gaps`: between samples. `smear`: 1 sigma by which noise displaces a sample. Both in mean gaps.
  // Columns that the same laser lines cross have the same gaps and tell of their length once,
  // `columns_of_line` together; of the longest each. `hidden`: what a column says that stops before
  // it by however much, as one does that something hides; 0: that denies the border.
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
  // `ahead`: lines that come again have the next one beyond the last for certain. Without it
  // columns of lines look like some more often, as those of scattered samples do.
  EndColumns(std::span<const EndSample> samples, double window_mm, double smear_mm,
             bool ahead = false);

  const std::vector<EndColumn>& seen() const { return seen_; }
  double width_rad() const;
  bool AreEnough() const;
  double MeanGapMm() const;
  // What is known when a rough plane is (EndSide): how many columns say the same, as the same laser
  // lines cross them.
  void LookAtSharedLines(const Eigen::Vector2d& rise_mm);
  const GapsBeforeBorder& gaps_before() const { return gaps_before_; }
  double columns_of_line() const { return columns_of_line_; }
  // Samples of neighbours lie beside each other, as those of a laser line do.
  bool share_lines() const { return share_lines_; }
  EndStops MakeStops(double smear_mm, double hidden = 0) const {
    return {gaps_, smear_mm / MeanGapMm(), columns_of_line_, hidden};
  }

 private:
  void Take(std::size_t k, double window_mm, double smear_mm, std::vector<double>& at);
  void Smooth();
  std::optional<double> ColumnsOfLine(const Eigen::Vector2d& rise_mm) const;

  bool ahead_ = false;
  std::size_t count_ = 0;
  std::vector<EndColumn> seen_;
  std::vector<std::vector<double>> at_;  // samples of those that were seen, in their order
  std::vector<double> gaps_;             // in mean gaps
  GapsBeforeBorder gaps_before_;
  double columns_of_line_ = 1;
  bool share_lines_ = false;
};

}  // namespace bendloop::pipeline
