// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_columns.h"
#include "pipeline/features/end_lines.h"
#include "pipeline/features/even_table.h"

namespace bendloop::pipeline {

// A place around the end that says whether the border lies beyond, or before it.
struct EndSide {
  double cosine = 1, sine = 0, at_mm = 0;
  double sigma_mm = 0;
  bool is_beyond = true;  // the border lies beyond
  bool is_told = false;   // by other sides: it says nothing more
  bool is_whole = false;  // a line that no lost ray hides

  // How far a plane is on the right side [mm]; `x`: at the axis, and by how much it rises towards
  // cosine and sine.
  double Clear(const Eigen::Vector3d& x) const {
    const double off = x[0] + cosine * x[1] + sine * x[2] - at_mm;
    return is_beyond ? off : -off;
  }
};

// A column of scattered samples.
struct EndStop {
  double cosine = 1, sine = 0, last_mm = 0, mean_gap_mm = 1;
};

// The sum of logarithms that sides give, by how far in sigmas the border is on the right side of
// each.
double LogOfHits(std::span<const double> clear);    // samples that met the wall: it goes as far
double LogOfMisses(std::span<const double> clear);  // lines that did not; some rays are lost
// The same of both of a plane (EndSide), which is on the right side of each by `more`, too.
void AddSide(const EndSide& side, double sigma_mm, PlaneLanes& lanes);
double LogOfSides(const PlaneLanes& sides, const double* x, double more);

// Where the border roughly is, by side or column.
struct RoughEndPlace {
  double cosine = 1, sine = 0, at_mm = 0;
};

// What is known of an end.
struct EndEvidence {
  std::vector<EndSide> sides;    // of laser lines: of each its last one, and where the next was
  double lines_greatest = 0;     // [sigma] how much nearer than they say the border may be
  std::vector<EndStop> columns;  // of scattered samples
  std::optional<EndStops> stops;
  std::optional<EndStops> stops_or_hidden;  // the same where something may hide them
  GapsBeforeBorder gaps_before;             // of columns
  double columns_of_line = 1;               // that say the same (EndColumns)
  bool share_lines = false;
  bool knows_passes = false;  // of `sides`, each line of which is known by itself
  double gap_mm = 0;          // mean gap between samples
  double width_rad = 0;       // of a column

  void AddLines(const LineBracket& lines);
  std::vector<RoughEndPlace> RoughPlaces() const;
};

// Where the plane roughly is, in mm (EndSide): least squares that leave out what lies far off.
Eigen::Vector3d RoughEndPlane(const EndEvidence& evidence, double pipe_radius_mm);

// The laser lines of all passes, where they cross enough of the turn.
std::optional<EndEvidence> LookAtEndLines(std::span<const EndSample> samples, double pipe_radius_mm,
                                          double window_mm, double smear_mm, double sigma_mm,
                                          bool knows_passes);

// Samples in columns, about a rough plane so that the border is level within each;
// the plane's slope goes to `slope_mm`.
std::optional<EndEvidence> LookAtEndColumns(std::span<const EndSample> samples,
                                            double pipe_radius_mm, double window_mm,
                                            double smear_mm, Eigen::Vector2d& slope_mm);

// The same about this slope. `may_be_lines`: columns may say the same, which costs a look at them.
// None: they are too few, or on too little of the turn.
std::optional<EndEvidence> EndColumnsAbout(std::span<const EndSample> samples, double window_mm,
                                           double smear_mm, const Eigen::Vector2d& slope_mm,
                                           bool may_be_lines = false);
// The same about a border that is this series (end_series.h).
std::optional<EndEvidence> EndColumnsAlong(std::span<const EndSample> samples, double window_mm,
                                           double smear_mm, const Eigen::VectorXd& series_mm,
                                           bool may_be_lines = false);

}  // namespace bendloop::pipeline
