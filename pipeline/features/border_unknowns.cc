// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_unknowns.h"

#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {
namespace {

// [part of the unit] What coincides with its joint is moved out of it.
constexpr double kLeastHandleLength = 1e-4;

}  // namespace

BorderUnknowns BorderUnknowns::Of(const RationalBezier& curve) {
  BorderUnknowns unknowns;
  unknowns.corner = curve.corner;
  unknowns.closed = curve.closed;
  const std::size_t n = curve.pieces.size();
  unknowns.unit_mm = std::max(curve.LengthMm() / static_cast<double>(n), 1e-12);
  unknowns.pieces.resize(n);
  for (std::size_t p = 0; p < n; ++p) {
    unknowns.joints_mm.push_back(curve.pieces[p].control_mm[0]);
    unknowns.pieces[p].start = p;
    unknowns.pieces[p].end = curve.closed ? (p + 1) % n : p + 1;
  }
  if (!curve.closed) unknowns.joints_mm.push_back(curve.pieces.back().control_mm[3]);
  for (std::size_t p = 0; p < n; ++p) {
    unknowns.pieces[p].start_tangent = unknowns.tangents.size();
    const bool shared = !curve.corner[p] && (p > 0 || curve.closed);
    const RationalCubic& before = curve.pieces[p > 0 ? p - 1 : n - 1];
    if (shared) {
      unknowns.pieces[p > 0 ? p - 1 : n - 1].end_tangent = unknowns.tangents.size();
      Eigen::Vector3d both = before.TangentAt(1) + curve.pieces[p].TangentAt(0);
      if (both.norm() < 1e-6) both = curve.pieces[p].TangentAt(0);
      unknowns.tangents.push_back(both.normalized());
      continue;
    }
    unknowns.tangents.push_back(curve.pieces[p].TangentAt(0));
    if (p == 0 && !curve.closed) continue;
    unknowns.pieces[p > 0 ? p - 1 : n - 1].end_tangent = unknowns.tangents.size();
    unknowns.tangents.push_back(before.TangentAt(1));
  }
  if (!curve.closed) {
    unknowns.pieces.back().end_tangent = unknowns.tangents.size();
    unknowns.tangents.push_back(curve.pieces.back().TangentAt(1));
  }
  for (std::size_t p = 0; p < n; ++p) {
    const RationalCubic piece = curve.pieces[p].InStandardForm();
    const auto handle = [&](std::size_t a, std::size_t b) {
      const double length_mm = (piece.control_mm[a] - piece.control_mm[b]).norm();
      return std::log(std::max(length_mm / unknowns.unit_mm, kLeastHandleLength));
    };
    unknowns.pieces[p].shape = {handle(0, 1), handle(2, 3), std::log(piece.weight[1]),
                                std::log(piece.weight[2])};
  }
  return unknowns;
}

RationalBezier BorderUnknowns::Curve() const {
  RationalBezier curve;
  curve.closed = closed;
  curve.corner = corner;
  for (const Piece& piece : pieces) {
    const Eigen::Vector3d &from = joints_mm[piece.start], &to = joints_mm[piece.end];
    RationalCubic cubic;
    cubic.control_mm = {from,
                        from + unit_mm * std::exp(piece.shape[0]) * tangents[piece.start_tangent],
                        to - unit_mm * std::exp(piece.shape[1]) * tangents[piece.end_tangent], to};
    cubic.weight = {1, std::exp(piece.shape[2]), std::exp(piece.shape[3]), 1};
    curve.pieces.push_back(cubic);
  }
  return curve;
}

int BorderUnknowns::Parameters() const {
  int count = static_cast<int>(4 * pieces.size() + 2 * tangents.size());
  for (std::size_t j = 0; j < joints_mm.size(); ++j) count += corner[j] ? 3 : 2;
  return count;
}

}  // namespace bendloop::pipeline
