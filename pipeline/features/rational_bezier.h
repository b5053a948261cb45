// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace bendloop::pipeline {

// One piece: a cubic rational Bezier curve, u from 0 to 1. Weights are positive.
// Source: Stamati & Fudos 2008, equation 3.1.
struct RationalCubic {
  std::array<Eigen::Vector3d, 4> control_mm;
  std::array<double, 4> weight = {1, 1, 1, 1};

  // Share of each control point at u; they sum to one.
  Eigen::Vector4d SharesAt(double u) const;
  Eigen::Vector3d At(double u) const;
  // First and second derivative by u.
  Eigen::Vector3d DerivativeAt(double u) const;
  Eigen::Vector3d SecondDerivativeAt(double u) const;
  // Unit; by the next control point where the one beside an end coincides with it.
  Eigen::Vector3d TangentAt(double u) const;
  // From end to end, straight.
  double ChordMm() const { return (control_mm[3] - control_mm[0]).norm(); }
  double LengthMm() const;
  // The same curve with both end weights 1, which a change of u alone brings about.
  RationalCubic InStandardForm() const;
  // The two parts before and after u, together the same curve.
  std::array<RationalCubic, 2> SplitAt(double u) const;
};

// A place on a curve, and how far a point is from it.
struct CurveFoot {
  std::size_t piece = 0;
  double u = 0;
  double distance_mm = 0;
};

// Pieces end to end. In a smooth joint the tangents agree (G1); a corner keeps its two tangents.
struct RationalBezier {
  std::vector<RationalCubic> pieces;
  bool closed = false;
  // Of the joint at the start of each piece, and for an open curve its two ends, which have no
  // tangent in common with anything: size pieces, or pieces + 1 when open.
  std::vector<bool> corner;

  double LengthMm() const;
  // The angle between the tangents on both sides of the joint at the start of `piece`; 0 at the
  // ends of an open curve. [rad]
  double JointAngle(std::size_t piece) const;
  // The nearest point. Exact up to the sampling that starts Newton's steps: 16 places a piece.
  CurveFoot NearestTo(const Eigen::Vector3d& point_mm) const;
  Eigen::Vector3d At(const CurveFoot& foot) const { return pieces[foot.piece].At(foot.u); }
  // `per_piece` places on each piece at even steps of u, and the end of an open curve.
  std::vector<Eigen::Vector3d> Sampled(int per_piece) const;
};

// The foot of a point on one piece, by Newton's steps from `u`; stays within 0 to 1.
double FootNear(const RationalCubic& piece, const Eigen::Vector3d& point_mm, double u);

}  // namespace bendloop::pipeline
