// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// A sample near an end: around the feed direction from AroundZero() [radians], and beyond the end
// along it [mm], negative on the tube. `pass`: of the scan; samples of scans that do not know their
// passes have all the same. `of_radius`: how far from the axis, of the pipe's radius; where the
// wall comes in or stands out at the end. `may_be_face`: it lies so low that it may be of the face
// that the cut left of the wall, which begins at the border.
struct EndSample {
  double around_rad = 0;
  double beyond_mm = 0;
  unsigned pass = 0;
  double of_radius = 1;
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();  // from the axis; none: by `around_rad`
  bool may_be_face = false;

  Eigen::Vector2d Direction() const {
    return direction.isZero(0.0) ? Eigen::Vector2d(std::cos(around_rad), std::sin(around_rad))
                                 : direction;
  }
};

// Brackets of a pass whose next lines are off together: so many of them tell of it.
constexpr std::size_t kToldOfNext = 5;

// Laser lines at one place around the end: the last that met the wall, and where the next would
// have met it.
struct LineBracket {
  double last_rad = 0, last_mm = 0, last_sigma_mm = 0;
  double next_rad = 0, next_mm = 0, next_sigma_mm = 0;
  // The next one is off together with those of other brackets, some of which tell of it; these tell
  // of a whole line, which no ray that is lost hides.
  bool next_is_told = false, next_is_whole = false;
};

// How samples along a narrow strip follow each other if they are those of laser lines that come
// again and again: after `period` lines (of one or more sweeps to and fro) all is as before.
struct LinePattern {
  double last_mm = 0, next_mm = 0;
  double round_mm = 0;              // of a period's lines
  double scatter_mm = 0;            // 1 sigma of a round
  std::size_t samples_of_last = 1;  // at the end of the samples
};
// `at`: sorted. None: they come as scattered samples do.
std::optional<LinePattern> FindLinePattern(std::span<const double> at);

// Of one pass of the scan, in as many strips as its rays tell apart. None: these samples are not
// those of laser lines. `window_mm`: from the border; `smear_mm`: 1 sigma by which noise displaces
// a sample. `knows_passes`: else they may be of several.
std::vector<LineBracket> FindLineBrackets(std::span<const EndSample> samples, double window_mm,
                                          double smear_mm, bool knows_passes);

}  // namespace bendloop::pipeline
