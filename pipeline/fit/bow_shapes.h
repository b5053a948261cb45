// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>

#include "pipeline/fit/surface_sums.h"

namespace bendloop::pipeline {

// What bows a straight: Legendre polynomials of its length, the second to the fourth, which have no
// part of its best-fit line. Each in y and z of the straight's frame. The fourth tells half a sine
// from a parabola: 5 % of its height, and a third of the slope at its ends, from where the bends go
// on.
constexpr std::size_t kBowShapes = 3;
constexpr int kBowModes = 2 * static_cast<int>(kBowShapes);
using BowModes = Eigen::Matrix<double, kBowModes, 1>;

// Of a segment's frame (its local state, surface_sums.h) by the modes of a straight.
using BowMotion = Eigen::Matrix<double, kLocalState, kBowModes>;

// A shape across the straight, by its length from -1 to 1, with its slope by that.
struct BowShape {
  double off, slope;
};
inline std::array<BowShape, kBowShapes> BowShapesAt(double x) {
  const double x2 = x * x;
  return {BowShape{1.5 * x2 - 0.5, 3.0 * x}, BowShape{(2.5 * x2 - 1.5) * x, 7.5 * x2 - 1.5},
          BowShape{(4.375 * x2 - 3.75) * x2 + 0.375, (17.5 * x2 - 7.5) * x}};
}
// How fast the slope grows, by that length.
inline std::array<double, kBowShapes> BowCurvaturesAt(double x) {
  return {3.0, 15.0 * x, 52.5 * x * x - 7.5};
}

// The part of a straight that its best-fit line is of, by its length from -1 to 1.
struct StraightMiddle {
  double from = -1, to = 1;
  double center() const { return 0.5 * (from + to); }
};
// The best-fit lines of the shapes over it, at its center.
inline std::array<BowShape, kBowShapes> BowLinesOf(const StraightMiddle& middle) {
  const double m = middle.center(), m2 = m * m;
  const double c2 = 0.25 * (middle.to - middle.from) * (middle.to - middle.from);
  return {BowShape{1.5 * m2 + 0.5 * c2 - 0.5, 3.0 * m},
          BowShape{(2.5 * (m2 + c2) - 1.5) * m, 7.5 * m2 + 1.5 * c2 - 1.5},
          BowShape{(4.375 * m2 + 8.75 * c2 - 3.75) * m2 + (0.875 * c2 - 1.25) * c2 + 0.375,
                   (17.5 * m2 + 10.5 * c2 - 7.5) * m}};
}

// A straight that bows: the heights of its modes [mm] about the best-fit line of its middle. It
// goes from tangent point to tangent point, and where bends ease these lie beyond the ends of its
// line.
struct Bow {
  BowModes modes_mm = BowModes::Zero();
  StraightMiddle middle;
  double before_mm = 0, after_mm = 0;  // how far beyond

  bool is_none() const { return modes_mm.isZero(0.0); }
  // Of a shape, in y and z.
  Eigen::Vector2d HeightMm(std::size_t shape) const {
    return modes_mm.segment<2>(2 * static_cast<Eigen::Index>(shape));
  }
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
    for (std::size_t s = 0; s < kBowShapes; ++s) {
      const double off = shapes[s].off + shapes[s].slope * (x - inside) - lines[s].off -
                         lines[s].slope * (x - middle.center());
      off_mm += off * HeightMm(s);
    }
    return off_mm;
  }

  // How steeply, by the same x.
  Eigen::Vector2d SlopeAt(double x) const {
    const auto shapes = BowShapesAt(std::clamp(x, -1.0, 1.0)), lines = BowLinesOf(middle);
    Eigen::Vector2d slope_mm = Eigen::Vector2d::Zero();
    for (std::size_t s = 0; s < kBowShapes; ++s) {
      slope_mm += (shapes[s].slope - lines[s].slope) * HeightMm(s);
    }
    return slope_mm;
  }
};

// The motion of a line's frame (at its start) that puts its place `along_mm` off by `off` and turns
// it by `slope`, for modes in y and z of each shape. What the shapes do at the line's start is
// taken off: there it goes on where the bend before it ended.
inline BowMotion BowMotionOf(const Bow& bow, const std::array<BowShape, kBowShapes>& shapes,
                             double along_mm, double line_mm) {
  const auto start = BowShapesAt(bow.At(0.0, line_mm));
  const double by_mm = 2.0 / bow.LengthMm(line_mm);
  BowMotion field = BowMotion::Zero();
  for (std::size_t s = 0; s < kBowShapes; ++s) {
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
