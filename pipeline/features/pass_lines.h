// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

namespace bendloop::pipeline {

// Where a laser line crosses a narrow strip along the tube: beyond the end, and in which direction
// from the axis.
struct StripCrossing {
  double at_mm = 0;
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();
  double sigma_mm = 0;  // 1 sigma of `at_mm`
};

// Where the line after the last one of a strip would have crossed it.
struct NextLine {
  double at_mm = 0, sigma_mm = 0;
  // No strip shows that line, or none near: other strips of the pass would have it as far off.
  bool is_shared = false;
};

// The laser lines of one pass, each followed across the strips. A hand holds the scanner neither at
// an even pace nor upright: its lines are as far apart, and tilted against each other, as it
// happens. But each lies in a plane, which the tube's wall meets where
//
//   at = c + p x + q y                  (x, y: the direction from the axis)
//
// so that one which an oblique end cuts off halfway is known where it is no more, and one that
// comes after all of them is expected as the others came.
class PassLines {
 public:
  // `strips`: side by side, each with its crossings along the tube, inwards to outwards.
  explicit PassLines(std::vector<std::vector<StripCrossing>> strips);

  // Of all places where a line would cross a strip between two that it crosses: how many it does
  // not. Strips are too narrow for the rays, or rays are lost.
  double lost_part() const { return lost_part_; }
  // Whether the line after the last one of a strip crosses some before it and behind it: it has
  // lost that.
  bool HasLostNext(std::size_t strip) const;

  // After the last crossing of a strip that has some. None: too few lines follow each other.
  std::optional<NextLine> After(std::size_t strip) const;

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  // What the crossings of a line and the next are apart in a strip.
  struct Step {
    double apart_mm = 0, variance_mm2 = 0;
    Eigen::Vector3d row;
  };
  // The strips that a line crosses first and last.
  struct Extent {
    std::size_t first = 0, last = 0, strips = 0;
  };
  void Link();
  void FindNext();
  void FindSteps();
  void LearnSteps();
  Eigen::Vector3d RowOf(const StripCrossing& crossing) const;

  std::vector<std::vector<StripCrossing>> strips_;
  std::vector<std::vector<std::size_t>> line_of_;  // of each crossing
  std::vector<Extent> extents_;                    // of each line
  std::vector<std::size_t> next_of_;               // of each line; kNone
  std::vector<std::vector<Step>> steps_;           // from each line to that
  Eigen::Vector2d middle_ = Eigen::Vector2d::Zero();
  double lost_part_ = 0;
  double gap_mm_ = 0;         // from a line to the next
  double gap_sigma_mm_ = 0;   // 1 sigma of one
  double tilt_sigma_mm_ = 0;  // the same of p and q
};

}  // namespace bendloop::pipeline
