// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/border_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// Handles stay this part of the chord, and weights within this and its inverse: beyond, a piece
// turns back on itself or hardly sees its own control point.
constexpr double kLeastHandle = 0.01, kLeastWeight = 0.05;
// The part of the error that an iteration must take off for another to follow.
constexpr double kSettled = 1e-9;

// The points of one piece, ends included, with their parameters (equation 3.3).
struct Segment {
  std::vector<std::size_t> points;
  std::vector<double> u;
  RationalCubic curve;
  Vector3d start_tangent = Vector3d::Zero(), end_tangent = Vector3d::Zero();
  double error_mm2 = 0;
  int iterations = 0;
};

// Index of point i of a border that may go round.
std::size_t Round(const OrderedBorder& border, std::size_t i) {
  return i % border.points_mm.size();
}

std::vector<Segment> CutIntoSegments(const OrderedBorder& border,
                                     const std::vector<std::size_t>& breaks) {
  std::vector<Segment> segments(breaks.size());
  for (std::size_t s = 0; s < breaks.size(); ++s) {
    std::size_t end = s + 1 < breaks.size() ? breaks[s + 1]
                      : border.closed       ? breaks[0] + border.points_mm.size()
                                            : border.points_mm.size() - 1;
    for (std::size_t i = breaks[s]; i <= end; ++i) segments[s].points.push_back(Round(border, i));
  }
  return segments;
}

// Section 4: a group of neighbours is represented by the one nearest to their centre of mass. The
// ends stay.
std::vector<std::size_t> Thinned(const OrderedBorder& border,
                                 const std::vector<std::size_t>& points, std::size_t most) {
  if (points.size() <= most || most < 3) return points;
  std::vector<std::size_t> few = {points.front()};
  const std::size_t inner = points.size() - 2, groups = most - 2;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t from = 1 + g * inner / groups, to = 1 + (g + 1) * inner / groups;
    Vector3d centre = Vector3d::Zero();
    for (std::size_t i = from; i < to; ++i) {
      centre += border.points_mm[points[i]] / static_cast<double>(to - from);
    }
    const auto nearest = std::min_element(points.begin() + static_cast<std::ptrdiff_t>(from),
                                          points.begin() + static_cast<std::ptrdiff_t>(to),
                                          [&](std::size_t a, std::size_t b) {
                                            return (border.points_mm[a] - centre).squaredNorm() <
                                                   (border.points_mm[b] - centre).squaredNorm();
                                          });
    few.push_back(*nearest);
  }
  few.push_back(points.back());
  return few;
}

void ParametriseByChord(const OrderedBorder& border, Segment& segment) {
  segment.u.assign(segment.points.size(), 0);
  for (std::size_t i = 1; i < segment.points.size(); ++i) {
    segment.u[i] =
        segment.u[i - 1] +
        (border.points_mm[segment.points[i]] - border.points_mm[segment.points[i - 1]]).norm();
  }
  const double whole = segment.u.back();
  for (double& u : segment.u) u = whole > 0 ? u / whole : 0;
}

// The tangent at the middle of five points from the four differences between them; at an end the
// missing ones are continued. Source: Renner 1982, in the form of Piegl & Tiller, equation 9.29.
Vector3d RennerTangent(const std::array<Vector3d, 4>& q) {
  const double before = q[0].cross(q[1]).norm(), after = q[2].cross(q[3]).norm();
  const double share = before + after > 0 ? before / (before + after) : 0.5;
  const Vector3d tangent = (1 - share) * q[1] + share * q[2];
  return tangent.norm() > 0 ? tangent.normalized() : q[2].normalized();
}

// `points` around number `at` of a thinned sequence; `low` and `high` are the last ones that belong
// to the same smooth stretch.
Vector3d TangentAmong(const OrderedBorder& border, const std::vector<std::size_t>& sequence,
                      std::ptrdiff_t at, std::ptrdiff_t low, std::ptrdiff_t high) {
  const auto point = [&](std::ptrdiff_t i) {
    return border.points_mm[sequence[static_cast<std::size_t>(i)]];
  };
  std::array<Vector3d, 4> q;
  std::array<bool, 4> known{};
  for (std::ptrdiff_t k = 0; k < 4; ++k) {
    const std::ptrdiff_t from = at - 2 + k;
    const auto place = static_cast<std::size_t>(k);
    known[place] = from >= low && from + 1 <= high;
    if (known[place]) q[place] = point(from + 1) - point(from);
  }
  if (!known[2] && !known[1]) return Vector3d::UnitX();
  // q_0 = 2 q_1 - q_2 and so on, outwards from what is known.
  if (!known[2]) q[2] = known[0] ? Vector3d(2 * q[1] - q[0]) : q[1];
  if (!known[3]) q[3] = known[1] || !known[2] ? Vector3d(2 * q[2] - q[1]) : q[2];
  if (!known[1]) q[1] = 2 * q[2] - q[3];
  if (!known[0]) q[0] = 2 * q[1] - q[2];
  return RennerTangent(q);
}

bool IsCorner(const OrderedBorder& border, std::size_t point) {
  return std::binary_search(border.corners.begin(), border.corners.end(), point);
}

void SetTangents(const OrderedBorder& border, std::vector<Segment>& segments) {
  for (std::size_t s = 0; s < segments.size(); ++s) {
    const bool joined = s > 0 || border.closed;
    Segment& before = segments[s > 0 ? s - 1 : segments.size() - 1];
    Segment& after = segments[s];
    if (joined && !IsCorner(border, after.points.front())) {
      std::vector<std::size_t> around = before.points;
      around.insert(around.end(), after.points.begin() + 1, after.points.end());
      const auto at = static_cast<std::ptrdiff_t>(before.points.size()) - 1;
      const Vector3d tangent =
          TangentAmong(border, around, at, 0, static_cast<std::ptrdiff_t>(around.size()) - 1);
      before.end_tangent = after.start_tangent = tangent;
      continue;
    }
    const auto last_of = [](const Segment& segment) {
      return static_cast<std::ptrdiff_t>(segment.points.size()) - 1;
    };
    after.start_tangent = TangentAmong(border, after.points, 0, 0, last_of(after));
    if (joined) {
      before.end_tangent = TangentAmong(border, before.points, last_of(before), 0, last_of(before));
    }
  }
  if (border.closed) return;
  Segment& last = segments.back();
  const auto end = static_cast<std::ptrdiff_t>(last.points.size()) - 1;
  last.end_tangent = TangentAmong(border, last.points, end, 0, end);
}

// Equation 3.5, with the denominators that 3.6 leaves out.
double ErrorMm2(const OrderedBorder& border, const Segment& segment, const RationalCubic& curve) {
  double sum = 0;
  for (std::size_t i = 0; i < segment.points.size(); ++i) {
    sum += (border.points_mm[segment.points[i]] - curve.At(segment.u[i])).squaredNorm();
  }
  return sum;
}

Eigen::Vector4d BernsteinAt(double u) {
  const double v = 1 - u;
  return {v * v * v, 3 * u * v * v, 3 * u * u * v, u * u * u};
}

double Positive(double weight) { return std::clamp(weight, kLeastWeight, 1 / kLeastWeight); }

// First step (equations 3.8 and 3.9): w_1, both handles and w_4 with w_2 = 1 and w_3 held, all
// three coordinates in one system.
RationalCubic SolveHandles(const OrderedBorder& border, const Segment& segment) {
  RationalCubic curve = segment.curve;
  const auto m = static_cast<int>(segment.points.size());
  Eigen::MatrixXd A(3 * m, 4);
  Eigen::VectorXd rhs(3 * m);
  const double w3 = curve.weight[2];
  for (int i = 0; i < m; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vector3d& q = border.points_mm[segment.points[k]];
    const Eigen::Vector4d b = BernsteinAt(segment.u[k]);
    const Vector3d from_start = q - curve.control_mm[0], from_end = q - curve.control_mm[3];
    A.block<3, 1>(3 * i, 0) = b[0] * from_start;
    A.block<3, 1>(3 * i, 1) = -b[1] * segment.start_tangent;
    A.block<3, 1>(3 * i, 2) = w3 * b[2] * segment.end_tangent;
    A.block<3, 1>(3 * i, 3) = b[3] * from_end;
    rhs.segment<3>(3 * i) = -b[1] * from_start - w3 * b[2] * from_end;
  }
  const Eigen::VectorXd x = LeastSquares(A, rhs);
  const double least_mm = kLeastHandle * curve.ChordMm();
  curve.weight[0] = Positive(x[0]);
  curve.weight[3] = Positive(x[3]);
  curve.control_mm[1] = curve.control_mm[0] + std::max(least_mm, x[1]) * segment.start_tangent;
  curve.control_mm[2] = curve.control_mm[3] - std::max(least_mm, x[2]) * segment.end_tangent;
  return curve;
}

// Second step (equations 3.11 and 3.12): w_1, w_3 and w_4 with the control points held.
RationalCubic SolveWeights(const OrderedBorder& border, const Segment& segment,
                           RationalCubic curve) {
  const auto m = static_cast<int>(segment.points.size());
  Eigen::MatrixXd A(3 * m, 3);
  Eigen::VectorXd rhs(3 * m);
  for (int i = 0; i < m; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Vector3d& q = border.points_mm[segment.points[k]];
    const Eigen::Vector4d b = BernsteinAt(segment.u[k]);
    A.block<3, 1>(3 * i, 0) = b[0] * (q - curve.control_mm[0]);
    A.block<3, 1>(3 * i, 1) = b[2] * (q - curve.control_mm[2]);
    A.block<3, 1>(3 * i, 2) = b[3] * (q - curve.control_mm[3]);
    rhs.segment<3>(3 * i) = -b[1] * (q - curve.control_mm[1]);
  }
  const Eigen::VectorXd x = LeastSquares(A, rhs);
  curve.weight = {Positive(x[0]), 1, Positive(x[1]), Positive(x[2])};
  return curve;
}

void Iterate(const OrderedBorder& border, Segment& segment, int iterations) {
  segment.error_mm2 = ErrorMm2(border, segment, segment.curve);
  if (segment.points.size() < 3) return;
  RationalCubic best = segment.curve;
  for (int i = 0; i < iterations; ++i) {
    const double before = segment.error_mm2;
    const RationalCubic handles = SolveHandles(border, segment);
    segment.curve = SolveWeights(border, segment, handles);
    ++segment.iterations;
    for (const RationalCubic& candidate : {handles, segment.curve}) {
      const double error = ErrorMm2(border, segment, candidate);
      if (error >= segment.error_mm2) continue;
      segment.error_mm2 = error;
      best = candidate;
    }
    if (i > 0 && before - segment.error_mm2 <= kSettled * before) break;
  }
  segment.curve = best;
}

void Refine(const OrderedBorder& border, Segment& segment) {
  for (std::size_t i = 1; i + 1 < segment.points.size(); ++i) {
    segment.u[i] = FootNear(segment.curve, border.points_mm[segment.points[i]], segment.u[i]);
  }
}

void Start(const OrderedBorder& border, Segment& segment) {
  const Vector3d& p1 = border.points_mm[segment.points.front()];
  const Vector3d& p4 = border.points_mm[segment.points.back()];
  double length_mm = 0;
  for (std::size_t i = 1; i < segment.points.size(); ++i) {
    length_mm +=
        (border.points_mm[segment.points[i]] - border.points_mm[segment.points[i - 1]]).norm();
  }
  segment.curve.control_mm = {p1, p1 + length_mm / 3 * segment.start_tangent,
                              p4 - length_mm / 3 * segment.end_tangent, p4};
  segment.curve.weight = {1, 1, 1, 1};
}

}  // namespace

double BorderFit::SumMm2() const {
  double sum = 0;
  for (const CurveFoot& foot : feet) sum += foot.distance_mm * foot.distance_mm;
  return sum;
}

double BorderFit::Relative() const {
  double sum = 0, points = 0;
  for (const PieceQuality& piece : quality) {
    sum += static_cast<double>(piece.points) * piece.Relative();
    points += static_cast<double>(piece.points);
  }
  return points > 0 ? sum / points : 0;
}

void MeasureQuality(BorderFit& fit) {
  fit.quality.assign(fit.curve.pieces.size(), {});
  for (std::size_t p = 0; p < fit.quality.size(); ++p) {
    fit.quality[p].chord_mm = fit.curve.pieces[p].ChordMm();
  }
  for (const CurveFoot& foot : fit.feet) {
    ++fit.quality[foot.piece].points;
    fit.quality[foot.piece].mean_square_mm2 += foot.distance_mm * foot.distance_mm;
  }
  for (PieceQuality& piece : fit.quality) {
    if (piece.points > 0) piece.mean_square_mm2 /= static_cast<double>(piece.points);
  }
}

std::vector<std::size_t> EvenBreaks(const OrderedBorder& border, std::size_t per_stretch) {
  const std::size_t n = border.points_mm.size();
  std::vector<std::size_t> stretches = border.corners;
  if (!border.closed || stretches.empty()) stretches.insert(stretches.begin(), 0);
  std::vector<std::size_t> breaks;
  for (std::size_t s = 0; s < stretches.size(); ++s) {
    const std::size_t from = stretches[s];
    const std::size_t to = s + 1 < stretches.size() ? stretches[s + 1]
                           : border.closed          ? stretches[0] + n
                                                    : n - 1;
    std::vector<double> along = {0};
    for (std::size_t i = from; i < to; ++i) {
      along.push_back(
          along.back() +
          (border.points_mm[Round(border, i + 1)] - border.points_mm[Round(border, i)]).norm());
    }
    std::size_t last = n;  // none
    for (std::size_t k = 0; k < per_stretch; ++k) {
      const double at = along.back() * static_cast<double>(k) / static_cast<double>(per_stretch);
      const auto place = static_cast<std::size_t>(std::lower_bound(along.begin(), along.end(), at) -
                                                  along.begin());
      const std::size_t point = Round(border, from + place);
      if (point != last && from + place < to) breaks.push_back(point);
      last = point;
    }
  }
  std::sort(breaks.begin(), breaks.end());
  breaks.erase(std::unique(breaks.begin(), breaks.end()), breaks.end());
  return breaks;
}

BorderFit FitBorderAsPaper(const OrderedBorder& border, const std::vector<std::size_t>& breaks,
                           const PaperFitOptions& options) {
  BorderFit fit;
  fit.curve.closed = border.closed;
  if (border.points_mm.size() < 4 || breaks.empty()) return fit;
  std::vector<Segment> segments = CutIntoSegments(border, breaks);
  for (Segment& segment : segments) {
    segment.points = Thinned(border, segment.points, options.points_of_piece);
    ParametriseByChord(border, segment);
  }
  SetTangents(border, segments);
  for (std::size_t s = 0; s < segments.size(); ++s) {
    Segment& segment = segments[s];
    Start(border, segment);
    Iterate(border, segment, options.iterations);
    for (int r = 0; r < options.refinements; ++r) {
      Refine(border, segment);
      Iterate(border, segment, options.iterations);
    }
    fit.curve.pieces.push_back(segment.curve);
    fit.curve.corner.push_back((s == 0 && !border.closed) ||
                               IsCorner(border, segment.points.front()));
    fit.iterations = std::max(fit.iterations, segment.iterations);
    // A joint's point is the next piece's.
    const bool is_last = !border.closed && s + 1 == segments.size();
    for (std::size_t i = 0; i + (is_last ? 0 : 1) < segment.points.size(); ++i) {
      const Vector3d& q = border.points_mm[segment.points[i]];
      fit.feet.push_back({s, segment.u[i], (segment.curve.At(segment.u[i]) - q).norm()});
    }
  }
  if (!border.closed) fit.curve.corner.push_back(true);
  MeasureQuality(fit);
  // Each piece: w_1, w_3, w_4 and two handles; its end point and tangent are the points' own.
  fit.parameters = static_cast<int>(5 * segments.size());
  const double left = 2.0 * static_cast<double>(fit.feet.size()) - fit.parameters;
  if (left > 0) fit.noise_sigma_mm = std::sqrt(fit.SumMm2() / left);
  return fit;
}

}  // namespace bendloop::pipeline
