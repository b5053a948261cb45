// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "pipeline/features/rational_bezier.h"

namespace bendloop::pipeline {

// Points of a border in their order along it.
struct OrderedBorder {
  std::vector<Eigen::Vector3d> points_mm;
  bool closed = false;
  // Indices of points, ascending, at which the border has a corner. The ends of an open border are
  // none.
  std::vector<std::size_t> corners;
};

// What is left of one piece's points: section 4's measure of a fit.
struct PieceQuality {
  std::size_t points = 0;
  double chord_mm = 0;
  double mean_square_mm2 = 0;  // E/m
  // Mean squared error over squared chord.
  double Relative() const { return chord_mm > 0 ? mean_square_mm2 / (chord_mm * chord_mm) : 0; }
};

struct BorderFit {
  RationalBezier curve;
  std::vector<CurveFoot> feet;  // of each point; the distance is from there
  std::vector<PieceQuality> quality;
  int iterations = 0;
  int parameters = 0;
  // 1 sigma of a point of the border off the curve, in one direction across it.
  double noise_sigma_mm = 0;
  // 1 sigma of the curve across itself, in one direction: root mean square along it, and its most.
  double curve_sigma_mm = 0, most_curve_sigma_mm = 0;

  double SumMm2() const;
  // The same measure over all pieces, each weighed by its points.
  double Relative() const;
};

struct PaperFitOptions {
  // Of both steps; the paper's examples stop after 1 to 30, mostly 10.
  int iterations = 10;
  // Points a piece that its tangents and weights are found from; groups beyond are represented by
  // the point nearest to their centre (section 4: 19 to 40).
  std::size_t points_of_piece = 40;
  // Times that chord parameters are replaced by those of the nearest points on the curve, each
  // followed by `iterations` more; 0 keeps the chord parameters, as the paper does.
  int refinements = 0;
};

// The paper's fit: `breaks` are the indices of the points at which pieces begin, ascending, for an
// open border without its last point. End points and end tangents are the points' own; each piece's
// handles and weights by two linear least squares in turn, until neither lowers the error.
// Errors are distances at equal parameters, as the paper's; those of the nearest points are
// smaller. Source: Stamati & Fudos 2008, section 3; what differs from its print stands in
// README.md.
BorderFit FitBorderAsPaper(const OrderedBorder& border, const std::vector<std::size_t>& breaks,
                           const PaperFitOptions& options);

// Where pieces begin if `per_stretch` are spread evenly by length between corners (or ends).
std::vector<std::size_t> EvenBreaks(const OrderedBorder& border, std::size_t per_stretch);

// Quality of each piece and sum of squares, from the feet.
void MeasureQuality(BorderFit& fit);

}  // namespace bendloop::pipeline
