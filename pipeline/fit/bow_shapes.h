// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

// What bows a straight: Legendre polynomials of its length, the second and the third, which have no
// part of its best-fit line. Each in y and z of the straight's frame.
constexpr int kBowModes = 4;

// Of a segment's frame (its local state, surface_sums.h) by the modes of a straight.
using BowMotion = Eigen::Matrix<double, kLocalState, kBowModes>;

// A shape across the straight, by its length from -1 to 1, with its slope by that.
struct BowShape {
  double off, slope;
};
inline std::array<BowShape, 2> BowShapesAt(double x) {
  return {BowShape{1.5 * x * x - 0.5, 3.0 * x},
          BowShape{(2.5 * x * x - 1.5) * x, 7.5 * x * x - 1.5}};
}
// How fast the slope grows, by that length.
inline std::array<double, 2> BowCurvaturesAt(double x) { return {3.0, 15.0 * x}; }

// The part of a straight that its best-fit line is of, by its length from -1 to 1.
struct StraightMiddle {
  double from = -1, to = 1;
  double center() const { return 0.5 * (from + to); }
};
// The best-fit lines of both shapes over it, at its center.
inline std::array<BowShape, 2> BowLinesOf(const StraightMiddle& middle) {
  const double m2 = middle.center() * middle.center();
  const double c2 = 0.25 * (middle.to - middle.from) * (middle.to - middle.from);
  return {BowShape{1.5 * m2 + 0.5 * c2 - 0.5, 3.0 * middle.center()},
          BowShape{(2.5 * (m2 + c2) - 1.5) * middle.center(), 7.5 * m2 + 1.5 * c2 - 1.5}};
}

// A straight that bows: the heights of its modes [mm] about the best-fit line of its middle. It
// goes from tangent point to tangent point, and where bends ease these lie beyond the ends of its
// line.
struct Bow {
  Eigen::Vector4d modes_mm = Eigen::Vector4d::Zero();
  StraightMiddle middle;
  double before_mm = 0, after_mm = 0;  // how far beyond

  bool is_none() const { return modes_mm.isZero(0.0); }
  double LengthMm(double line_mm) const { return line_mm + before_mm + after_mm; }
  // By its length from -1 to 1: what lies so far along its line.
  double At(double along_mm, double line_mm) const {
    return 2.0 * (along_mm + before_mm) / LengthMm(line_mm) - 1.0;
  }
  // How far its spine lies beside that line, in y and z; beyond its ends it goes straight on.
  Eigen::Vector2d Beside(double x) const {
    const double inside = std::clamp(x, -1.0, 1.0);
    const auto shapes = BowShapesAt(inside), lines = BowLinesOf(middle);
    Eigen::Vector2d off_mm = Eigen::Vector2d::Zero();
    for (std::size_t s = 0; s < 2; ++s) {
      const double off = shapes[s].off + shapes[s].slope * (x - inside) - lines[s].off -
                         lines[s].slope * (x - middle.center());
      off_mm += off * modes_mm.segment<2>(2 * static_cast<Eigen::Index>(s));
    }
    return off_mm;
  }

  // How steeply, by the same x.
  Eigen::Vector2d SlopeAt(double x) const {
    const auto shapes = BowShapesAt(std::clamp(x, -1.0, 1.0)), lines = BowLinesOf(middle);
    return (shapes[0].slope - lines[0].slope) * modes_mm.head<2>() +
           (shapes[1].slope - lines[1].slope) * modes_mm.tail<2>();
  }
};

// The motion of a line's frame (at its start) that puts its place `along_mm` off by `off` and turns
// it by `slope`, for modes in y and z of each shape. What the shapes do at the line's start is
// taken off: there it goes on where the bend before it ended.
inline BowMotion BowMotionOf(const Bow& bow, const std::array<BowShape, 2>& shapes, double along_mm,
                             double line_mm) {
  const auto start = BowShapesAt(bow.At(0.0, line_mm));
  const double by_mm = 2.0 / bow.LengthMm(line_mm);
  BowMotion field = BowMotion::Zero();
  for (std::size_t s = 0; s < 2; ++s) {
    const double off = shapes[s].off - start[s].off - start[s].slope * by_mm * along_mm;
    const double slope = (shapes[s].slope - start[s].slope) * by_mm;
    const auto column = static_cast<Eigen::Index>(2 * s);
    field(1, column) = off - slope * along_mm;
    field(5, column) = slope;
    field(2, column + 1) = off - slope * along_mm;
    field(4, column + 1) = -slope;
  }
  return field;
}

}  // namespace bendloop::pipeline
