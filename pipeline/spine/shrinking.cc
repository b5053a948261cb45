// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/shrinking.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "pipeline/math/quantiles.h"
#include "pipeline/points/point_index.h"

namespace bendloop::pipeline {
namespace {

// When samples have met, and what of them becomes nodes (Lee & Kim 2004). By trial where nothing
// else is said.
struct MeetingSettings {
  // [of the peak] So few that meet say that the samples have passed each other.
  double past_peak = 0.8;
  // [of the samples] Less is chance.
  double least_met = 0.1;
  // [of a step] How finely the peak is looked for, around the best of the steps.
  double fine_step = 0.25;
  // [of the meeting distance] The peak is flat while the samples are dense; a finer one makes it
  // sharp.
  double fine_meet = 0.4;
  // [of the pipe radius] Edge of a cell, which becomes one node at most.
  double cell = 0.25;
  // Times that a node is moved onto the local regression curve.
  int thinning_rounds = 3;
  // Fewer make no curve: each of its two parabolas has three numbers.
  std::size_t least_neighbours = 8;
  // Thickness over length of a piece of a curve-like set; a rounder one has no direction.
  double most_thickness = 0.6;
  // [of the pipe radius] From the cell's mean to the node.
  double most_move = 0.5;
};
constexpr MeetingSettings kMeeting;

struct Shrunk {
  std::vector<Eigen::Vector3d> shrunk;
  std::vector<Eigen::Vector3d> original;
};

// Whether sample i meets another: within `meet_mm`, with a normal that points elsewhere.
bool Meets(std::size_t i, const PointIndex& index, std::span<const Eigen::Vector3d> moved,
           std::span<const OrientedSample> samples, double meet_mm, double cosine) {
  bool met = false;
  index.Visit(moved[i], meet_mm, [&](std::size_t j) {
    met = met || samples[j].outward.dot(samples[i].outward) < cosine;
  });
  return met;
}

std::vector<bool> MeetAt(double distance_mm, double meet_mm, double cosine,
                         std::span<const OrientedSample> samples) {
  std::vector<Eigen::Vector3d> moved;
  moved.reserve(samples.size());
  for (const OrientedSample& s : samples) moved.push_back(s.position_mm - distance_mm * s.outward);
  const PointIndex index(moved, meet_mm);
  std::vector<bool> met(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    met[i] = Meets(i, index, moved, samples, meet_mm, cosine);
  }
  return met;
}

std::size_t Count(const std::vector<bool>& met) {
  return static_cast<std::size_t>(std::count(met.begin(), met.end(), true));
}

// Wyvill's weight, equation (3).
double Weight(double distance, double support) {
  const double u = distance / support;
  return u < 1 ? (2 * u - 3) * u * u + 1 : 0.0;
}

// The local regression curve: a line through the weighted mean, and above it a parabola in each of
// the two directions across, which is the paper's osculating plane without having to find it.
struct LocalCurve {
  Eigen::Vector3d mean, t, n, b;
  Eigen::Vector3d across_n, across_b;  // coefficients of 1, a, a^2
  double thickness = 0;
  double rms_mm = 0;

  Eigen::Vector3d PointAt(double a) const {
    const Eigen::Vector3d powers(1, a, a * a);
    return mean + a * t + across_n.dot(powers) * n + across_b.dot(powers) * b;
  }
  Eigen::Vector3d TangentAt(double a) const {
    return (t + (across_n[1] + 2 * a * across_n[2]) * n + (across_b[1] + 2 * a * across_b[2]) * b)
        .normalized();
  }
};

std::optional<LocalCurve> FitLocalCurve(const Eigen::Vector3d& at,
                                        std::span<const std::size_t> neighbours,
                                        std::span<const Eigen::Vector3d> points, double support) {
  if (neighbours.size() < kMeeting.least_neighbours) return std::nullopt;
  double sum = 0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const std::size_t j : neighbours) {
    const double w = Weight((points[j] - at).norm(), support);
    sum += w;
    mean += w * (points[j] - at);
  }
  if (!(sum > 0)) return std::nullopt;
  mean /= sum;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const std::size_t j : neighbours) {
    const Eigen::Vector3d v = points[j] - at - mean;
    covariance += Weight((points[j] - at).norm(), support) * v * v.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(covariance / sum);
  LocalCurve curve;
  curve.mean = at + mean;
  curve.t = eigen.eigenvectors().col(2);
  curve.n = eigen.eigenvectors().col(1);
  curve.b = curve.t.cross(curve.n);
  const double length = std::sqrt(std::max(eigen.eigenvalues()[2], 1e-300));
  curve.thickness = std::sqrt(std::max(eigen.eigenvalues()[1], 0.0)) / length;
  Eigen::Matrix3d normal = 1e-9 * Eigen::Matrix3d::Identity();
  Eigen::Vector3d right_n = Eigen::Vector3d::Zero();
  Eigen::Vector3d right_b = Eigen::Vector3d::Zero();
  double sum2 = 0;
  for (const std::size_t j : neighbours) {
    const double w = Weight((points[j] - at).norm(), support) / sum;
    const Eigen::Vector3d v = points[j] - curve.mean;
    const double a = v.dot(curve.t) / length;
    const Eigen::Vector3d powers(1, a, a * a);
    const double vn = v.dot(curve.n);
    const double vb = v.dot(curve.b);
    normal += w * powers * powers.transpose();
    right_n += w * vn * powers;
    right_b += w * vb * powers;
    sum2 += w * (vn * vn + vb * vb);
  }
  const Eigen::LDLT<Eigen::Matrix3d> ldlt(normal);
  const Eigen::Vector3d kn = ldlt.solve(right_n);
  const Eigen::Vector3d kb = ldlt.solve(right_b);
  if (!kn.allFinite() || !kb.allFinite()) return std::nullopt;
  curve.rms_mm = std::sqrt(std::max(0.0, sum2 - kn.dot(right_n) - kb.dot(right_b)));
  const Eigen::Vector3d scale(1, 1 / length, 1 / (length * length));
  curve.across_n = kn.cwiseProduct(scale);
  curve.across_b = kb.cwiseProduct(scale);
  return curve;
}

// Moving least squares on the shrunk set: one node for each cell that holds some of it.
std::vector<SpineNode> ThinToCurve(const Shrunk& set, const ShrinkingOptions& options) {
  const double support = options.support * options.radius_mm;
  const PointIndex index(set.shrunk, 0.5 * support);
  std::vector<SpineNode> nodes;
  std::vector<std::size_t> neighbours;
  for (Eigen::Vector3d at : CellMeans(set.shrunk, kMeeting.cell * options.radius_mm)) {
    const Eigen::Vector3d start = at;
    std::optional<LocalCurve> curve;
    for (int round = 0; round < kMeeting.thinning_rounds; ++round) {
      neighbours.clear();
      index.Visit(at, support, [&](std::size_t j) { neighbours.push_back(j); });
      curve = FitLocalCurve(at, neighbours, set.shrunk, support);
      if (!curve || curve->thickness > kMeeting.most_thickness) break;
      at = curve->PointAt((at - curve->mean).dot(curve->t));
    }
    if (!curve || curve->thickness > kMeeting.most_thickness ||
        (at - start).norm() > kMeeting.most_move * options.radius_mm) {
      continue;
    }
    // Equation (6), here from the samples around the node only: the radius may vary.
    std::vector<double> radii;
    for (const std::size_t j : neighbours) {
      const double a = (set.shrunk[j] - curve->mean).dot(curve->t);
      const Eigen::Vector3d v = set.original[j] - curve->PointAt(a);
      const Eigen::Vector3d t = curve->TangentAt(a);
      if ((set.shrunk[j] - at).squaredNorm() > 0.25 * support * support) continue;
      radii.push_back((v - v.dot(t) * t).norm());
    }
    if (radii.size() < kMeeting.least_neighbours) continue;
    const double a = (at - curve->mean).dot(curve->t);
    nodes.push_back(
        {at, curve->TangentAt(a), curve->rms_mm, neighbours.size(), Median(std::move(radii))});
  }
  return nodes;
}

double MeanRadius(std::span<const SpineNode> nodes) {
  std::vector<double> radii;
  radii.reserve(nodes.size());
  for (const SpineNode& node : nodes) radii.push_back(node.radius_mm);
  return Median(std::move(radii));
}

}  // namespace

ShrunkSpine ShrinkPipe(std::span<const OrientedSample> samples, const ShrinkingOptions& options) {
  ShrunkSpine result;
  if (samples.empty()) return result;
  const double meet_mm = options.meet * options.radius_mm;
  const double step_mm = options.step * options.radius_mm;
  std::size_t peak = 0;
  double peak_mm = 0;
  for (int k = 1; k * step_mm <= options.most * options.radius_mm; ++k) {
    result.steps = k;
    const std::size_t count = Count(MeetAt(k * step_mm, meet_mm, options.cosine, samples));
    if (count > peak) {
      peak = count;
      peak_mm = k * step_mm;
    } else if (static_cast<double>(peak) >
                   kMeeting.least_met * static_cast<double>(samples.size()) &&
               static_cast<double>(count) < kMeeting.past_peak * static_cast<double>(peak)) {
      break;
    }
  }
  if (static_cast<double>(peak) < kMeeting.least_met * static_cast<double>(samples.size())) {
    return result;
  }
  // The peak is flat while the samples are dense; a finer meeting distance makes it sharp.
  double best_mm = peak_mm;
  std::size_t best = 0;
  for (double d = peak_mm - 2 * step_mm; d <= peak_mm + 2 * step_mm;
       d += kMeeting.fine_step * step_mm) {
    const std::size_t count =
        Count(MeetAt(d, kMeeting.fine_meet * meet_mm, options.cosine, samples));
    if (count > best) {
      best = count;
      best_mm = d;
    }
  }
  const std::vector<bool> met = MeetAt(best_mm, meet_mm, options.cosine, samples);
  Shrunk set;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (!met[i]) continue;
    set.shrunk.push_back(samples[i].position_mm - best_mm * samples[i].outward);
    set.original.push_back(samples[i].position_mm);
  }
  result.met = static_cast<double>(set.shrunk.size()) / static_cast<double>(samples.size());
  result.nodes = ThinToCurve(set, options);
  result.pipe_radius_mm = result.nodes.empty() ? 0.0 : MeanRadius(result.nodes);
  return result;
}

ShrunkSpine ShrinkCanal(std::span<const OrientedSample> samples, const ShrinkingOptions& options) {
  ShrunkSpine result;
  if (samples.empty()) return result;
  const double meet_mm = options.meet * options.radius_mm;
  const double step_mm = options.step * options.radius_mm;
  std::vector<Eigen::Vector3d> moved;
  moved.reserve(samples.size());
  for (const OrientedSample& s : samples) moved.push_back(s.position_mm);
  std::vector<bool> stopped(samples.size(), false);
  for (int k = 1; k * step_mm <= options.most * options.radius_mm; ++k) {
    result.steps = k;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      if (!stopped[i]) moved[i] -= step_mm * samples[i].outward;
    }
    const PointIndex index(moved, meet_mm);
    std::vector<bool> now(samples.size(), false);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      now[i] = !stopped[i] && Meets(i, index, moved, samples, meet_mm, options.cosine);
    }
    for (std::size_t i = 0; i < samples.size(); ++i) stopped[i] = stopped[i] || now[i];
  }
  Shrunk set;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (!stopped[i]) continue;
    set.shrunk.push_back(moved[i]);
    set.original.push_back(samples[i].position_mm);
  }
  result.met = static_cast<double>(set.shrunk.size()) / static_cast<double>(samples.size());
  if (result.met < kMeeting.least_met) return result;
  result.nodes = ThinToCurve(set, options);
  result.pipe_radius_mm = result.nodes.empty() ? 0.0 : MeanRadius(result.nodes);
  return result;
}

}  // namespace bendloop::pipeline
