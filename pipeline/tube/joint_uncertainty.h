// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace bendloop::pipeline {

enum class RowValueKind : std::uint8_t { kLength, kRotation, kAngle, kBendRadius };

// One number of a program: which row, which column.
struct RowValue {
  std::size_t row = 0;
  RowValueKind kind = RowValueKind::kLength;

  bool operator==(const RowValue&) const = default;
};

// The errors of two values go together: the coefficient of correlation, -1 to 1.
struct Correlation {
  RowValue first, second;
  double coefficient = 0;
};

// Bends that follow each other and whose values the samples hardly tell apart, with what they do
// tell: how the tube goes on behind these bends, seen from before them. NaN: no better known than
// the values themselves, or there is no such thing.
struct KnownTogether {
  std::size_t first_bend = 0, last_bend = 0;
  std::vector<RowValue> values;  // vague, or in strong correlation with one that is
  // 1 sigma of the direction of the straight behind against the one before, the worse way across.
  double direction_sigma_deg = std::numeric_limits<double>::quiet_NaN();
  // 1 sigma of the plane of the next bend against that of the bend before.
  double plane_sigma_deg = std::numeric_limits<double>::quiet_NaN();
  // Of the spine, both straights included, and its 1 sigma.
  double length_mm = std::numeric_limits<double>::quiet_NaN();
  double length_sigma_mm = std::numeric_limits<double>::quiet_NaN();
};

// What the sigmas of single values do not say.
struct JointUncertainty {
  bool is_known = true;                       // false: nobody looked, as for canals
  std::vector<Correlation> correlations;      // strong ones; by row
  std::vector<KnownTogether> known_together;  // by bend
};

}  // namespace bendloop::pipeline
