// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/rational_bezier.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace bendloop::pipeline {
namespace {

// Starts of the search for the nearest point, on each piece.
constexpr int kStarts = 16;
constexpr int kNewtonSteps = 20;
// [part of a piece's parameter] Closer no foot is asked for.
constexpr double kSettledU = 1e-14;

Eigen::Vector4d Bernstein(double u) {
  const double v = 1.0 - u;
  return {v * v * v, 3 * u * v * v, 3 * u * u * v, u * u * u};
}

Eigen::Vector4d BernsteinSlope(double u) {
  const double v = 1.0 - u;
  return {-3 * v * v, 3 * v * v - 6 * u * v, 6 * u * v - 3 * u * u, 3 * u * u};
}

Eigen::Vector4d BernsteinBend(double u) { return {6 * (1 - u), 18 * u - 12, 6 - 18 * u, 6 * u}; }

// Numerator and denominator of equation 3.1 for one of the three sets of polynomials.
struct Homogeneous {
  Eigen::Vector3d point;
  double weight;
};

Homogeneous Weighed(const RationalCubic& piece, const Eigen::Vector4d& basis) {
  Homogeneous sum{Eigen::Vector3d::Zero(), 0};
  for (std::size_t j = 0; j < 4; ++j) {
    const double w = piece.weight[j] * basis[static_cast<int>(j)];
    sum.point += w * piece.control_mm[j];
    sum.weight += w;
  }
  return sum;
}

}  // namespace

Eigen::Vector4d RationalCubic::SharesAt(double u) const {
  const Eigen::Vector4d shares =
      Bernstein(u).cwiseProduct(Eigen::Map<const Eigen::Vector4d>(weight.data()));
  return shares / shares.sum();
}

Eigen::Vector3d RationalCubic::At(double u) const {
  const Homogeneous c = Weighed(*this, Bernstein(u));
  return c.point / c.weight;
}

Eigen::Vector3d RationalCubic::DerivativeAt(double u) const {
  const Homogeneous c = Weighed(*this, Bernstein(u)), d = Weighed(*this, BernsteinSlope(u));
  return (d.point - d.weight * (c.point / c.weight)) / c.weight;
}

Eigen::Vector3d RationalCubic::SecondDerivativeAt(double u) const {
  const Homogeneous c = Weighed(*this, Bernstein(u)), d = Weighed(*this, BernsteinSlope(u));
  const Homogeneous e = Weighed(*this, BernsteinBend(u));
  const Eigen::Vector3d at = c.point / c.weight;
  const Eigen::Vector3d slope = (d.point - d.weight * at) / c.weight;
  return (e.point - 2 * d.weight * slope - e.weight * at) / c.weight;
}

Eigen::Vector3d RationalCubic::TangentAt(double u) const {
  Eigen::Vector3d tangent = DerivativeAt(u);
  const double scale = ChordMm() + (control_mm[1] - control_mm[0]).norm();
  if (tangent.norm() > 1e-12 * scale) return tangent.normalized();
  tangent = u < 0.5 ? control_mm[2] - control_mm[0] : control_mm[3] - control_mm[1];
  return tangent.norm() > 0 ? tangent.normalized() : Eigen::Vector3d::Zero();
}

double RationalCubic::LengthMm() const {
  // Five points of Gauss-Legendre on each eighth: 1e-7 of the length for weights of 0.5 to 2.
  constexpr std::array<double, 5> kPlace = {-0.9061798459386640, -0.5384693101056831, 0,
                                            0.5384693101056831, 0.9061798459386640};
  constexpr std::array<double, 5> kShare = {0.2369268850561891, 0.4786286704993665,
                                            0.5688888888888889, 0.4786286704993665,
                                            0.2369268850561891};
  constexpr int kParts = 8;
  double length_mm = 0;
  for (int part = 0; part < kParts; ++part) {
    for (std::size_t i = 0; i < kPlace.size(); ++i) {
      const double u = (part + 0.5 + 0.5 * kPlace[i]) / kParts;
      length_mm += 0.5 / kParts * kShare[i] * DerivativeAt(u).norm();
    }
  }
  return length_mm;
}

RationalCubic RationalCubic::InStandardForm() const {
  // With u = s / (s + c (1 - s)), weight j becomes w_j c^(3 - j) up to a common factor.
  const double c = std::cbrt(weight[3] / weight[0]);
  RationalCubic standard = *this;
  double power = c * c * c;
  for (std::size_t j = 0; j < 4; ++j, power /= c)
    standard.weight[j] = weight[j] * power / weight[3];
  return standard;
}

std::array<RationalCubic, 2> RationalCubic::SplitAt(double u) const {
  std::array<Eigen::Vector4d, 4> level;
  for (std::size_t j = 0; j < 4; ++j) {
    level[j] << weight[j] * control_mm[j], weight[j];
  }
  std::array<RationalCubic, 2> parts;
  const auto put = [](RationalCubic& part, std::size_t j, const Eigen::Vector4d& h) {
    part.control_mm[j] = h.head<3>() / h[3];
    part.weight[j] = h[3];
  };
  for (std::size_t step = 0; step < 4; ++step) {  // de Casteljau
    put(parts[0], step, level[0]);
    put(parts[1], 3 - step, level[3 - step]);
    for (std::size_t j = 0; j + step + 1 < 4; ++j) {
      level[j] = (1 - u) * level[j] + u * level[j + 1];
    }
  }
  return parts;
}

double FootNear(const RationalCubic& piece, const Eigen::Vector3d& point_mm, double u) {
  double best_mm2 = (piece.At(u) - point_mm).squaredNorm();
  for (int step = 0; step < kNewtonSteps; ++step) {
    const Eigen::Vector3d off = piece.At(u) - point_mm;
    const Eigen::Vector3d d1 = piece.DerivativeAt(u);
    const double gradient = off.dot(d1), square = d1.squaredNorm();
    if (square <= 0) return u;
    // Beyond the centre of curvature Newton's step leads away; Gauss's always leads down.
    const double newton = square + off.dot(piece.SecondDerivativeAt(u));
    double change = -gradient / (newton > 0.1 * square ? newton : square);
    double next = u;
    double next_mm2 = best_mm2;
    for (int halving = 0; halving < 8; ++halving, change *= 0.5) {
      next = std::clamp(u + change, 0.0, 1.0);
      next_mm2 = (piece.At(next) - point_mm).squaredNorm();
      if (next_mm2 <= best_mm2) break;
    }
    if (!(next_mm2 <= best_mm2)) return u;
    const bool settled = std::abs(next - u) < kSettledU;
    u = next;
    best_mm2 = next_mm2;
    if (settled) return u;
  }
  return u;
}

double RationalBezier::LengthMm() const {
  double length_mm = 0;
  for (const RationalCubic& piece : pieces) length_mm += piece.LengthMm();
  return length_mm;
}

double RationalBezier::JointAngle(std::size_t piece) const {
  if (pieces.empty() || (piece == 0 && !closed) || piece >= pieces.size()) return 0;
  const RationalCubic& before = pieces[piece == 0 ? pieces.size() - 1 : piece - 1];
  const Eigen::Vector3d a = before.TangentAt(1), b = pieces[piece].TangentAt(0);
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

CurveFoot RationalBezier::NearestTo(const Eigen::Vector3d& point_mm) const {
  CurveFoot nearest;
  double best_mm2 = std::numeric_limits<double>::infinity();
  for (std::size_t p = 0; p < pieces.size(); ++p) {
    std::array<double, kStarts + 1> square_mm2;
    for (int i = 0; i <= kStarts; ++i) {
      square_mm2[static_cast<std::size_t>(i)] =
          (pieces[p].At(static_cast<double>(i) / kStarts) - point_mm).squaredNorm();
    }
    const auto least = std::min_element(square_mm2.begin(), square_mm2.end());
    const double start = static_cast<double>(least - square_mm2.begin()) / kStarts;
    const double u = FootNear(pieces[p], point_mm, start);
    const double found_mm2 = (pieces[p].At(u) - point_mm).squaredNorm();
    if (found_mm2 < best_mm2) {
      best_mm2 = found_mm2;
      nearest = {p, u, std::sqrt(found_mm2)};
    }
  }
  return nearest;
}

std::vector<Eigen::Vector3d> RationalBezier::Sampled(int per_piece) const {
  std::vector<Eigen::Vector3d> places;
  for (const RationalCubic& piece : pieces) {
    for (int i = 0; i < per_piece; ++i) {
      places.push_back(piece.At(static_cast<double>(i) / per_piece));
    }
  }
  if (!closed && !pieces.empty()) places.push_back(pieces.back().control_mm[3]);
  return places;
}

}  // namespace bendloop::pipeline
