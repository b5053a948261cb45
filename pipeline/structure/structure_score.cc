// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_score.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/tube_parameters.h"

namespace bendloop::pipeline {
namespace {

constexpr double kPiece = 0.75;     // of r_P: how finely places are told
constexpr double kMaxPieces = 60;   // of a segment
constexpr double kWide = 4.0;       // of sigma, for the weights
constexpr double kNoLength = 1e-6;  // mm
constexpr double kRange = 0.5;      // of r_P, 1 sigma
constexpr double kRangeRad = 0.1;
constexpr double kEnd = 1.0;          // of r_P: nearer to the end of the samples nothing is asked
constexpr double kNegligible = 1e-9;  // of the largest eigenvalue: a turn that no sample feels

using Motion = Eigen::Matrix<double, 6, 1>;  // velocity at the origin and angular velocity, world
using MotionMap = Eigen::Matrix<double, 6, 6>;

Eigen::Matrix3d Cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// From a rigid motion of the world to that of a segment's frame.
MotionMap ToFrame(const hal::SpineSegment& segment, const Eigen::Vector3d& origin) {
  Eigen::Matrix3d frame;
  frame.row(0) = segment.tangent;
  frame.row(1) = segment.normal.cross(segment.tangent);
  frame.row(2) = segment.normal;
  MotionMap map = MotionMap::Zero();
  map.topLeftCorner<3, 3>() = frame;
  map.topRightCorner<3, 3>() = -frame * Cross(segment.start_mm - origin);
  map.bottomRightCorner<3, 3>() = frame;
  return map;
}

// The samples of a part of a segment, in its frame.
struct Piece {
  std::size_t segment = 0;
  double begin_mm = 0;
  SegmentPoints points;
};

double AlongOf(const SegmentPoints& points, Eigen::Index i, const hal::SpineSegment& segment) {
  if (!segment.is_arc()) return points.x[i];
  const double middle = 0.5 * segment.angle_rad();
  const double phi = std::atan2(points.x[i], -points.y[i]);
  return segment.bend_radius_mm * (middle + std::remainder(phi - middle, 2.0 * std::numbers::pi));
}

std::vector<Piece> Pieces(const std::vector<hal::SpineSegment>& segments,
                          const SurfaceAssignment& assignment, double pipe_radius_mm) {
  std::vector<Piece> pieces;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const SegmentPoints& points = assignment.segments[k];
    const double length_mm = segments[k].length_mm;
    const double wanted = std::ceil(length_mm / (kPiece * pipe_radius_mm));
    const auto count = static_cast<int>(std::clamp(wanted, 1.0, kMaxPieces));
    const std::size_t first = pieces.size();
    for (int i = 0; i < count; ++i) {
      pieces.push_back({k, length_mm * i / count, {}});
    }
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
      const double part = length_mm > 0 ? AlongOf(points, i, segments[k]) / length_mm : 0.0;
      const double place = std::clamp(std::floor(part * count), 0.0, count - 1.0);
      pieces[first + static_cast<std::size_t>(place)].points.Add(points, i);
    }
  }
  return pieces;
}

// What a tube may do at a place: a line may turn across itself; an arc also about itself (another
// plane from here on), and a straight may stand in it.
constexpr int kArcModes = 4;
using Modes = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kArcModes>;
using ModeMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kArcModes, kArcModes>;
using ModeVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kArcModes, 1>;

Modes ModesAt(const hal::SpineSegment& segment, double along_mm, const Eigen::Vector3d& origin) {
  const Eigen::Vector3d at = segment.PointAt(along_mm);
  const Eigen::Vector3d tangent = segment.TangentAt(along_mm);
  const bool arc = segment.is_arc() && along_mm > 0;
  Modes modes = Modes::Zero(6, arc ? kArcModes : 2);
  modes.col(0).tail<3>() = segment.normal;
  modes.col(1).tail<3>() = segment.normal.cross(tangent);
  if (arc) modes.col(2).tail<3>() = tangent;
  for (Eigen::Index m = 0; m < (arc ? 3 : 2); ++m) {
    modes.col(m).head<3>() = -modes.col(m).tail<3>().cross(at - origin);
  }
  if (arc) modes.col(3) << tangent, Eigen::Vector3d::Zero();
  return modes;
}

}  // namespace

std::vector<MissingBend> FindMissingBends(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                          double reach_mm) {
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const TubeParameters parameters(fit.tube, true, fit.flattening);
  const auto derivatives = parameters.FrameDerivatives(segments);
  const double r = fit.tube.pipe_radius_mm;
  const auto frames = SegmentFrames(segments, kBeyond * r, fit.flattening);
  SurfaceAssignment assignment;
  AssignPoints(frames, r, blocks, reach_mm, assignment);
  const std::vector<Piece> pieces = Pieces(segments, assignment, r);
  // Where a bend is missing distances are large, and they are what is looked for here.
  const double wide_sigma_mm = std::min(kWide * fit.sigma_mm, reach_mm / kFullWeight);
  const Eigen::Vector3d origin = segments[segments.size() / 2].start_mm;

  // From the last piece to the first: what all pieces from here on say of a common motion.
  const Eigen::Index n = parameters.size();
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd slope = Eigen::VectorXd::Zero(n);
  struct Suffix {
    MotionMap information = MotionMap::Zero();
    Motion slope = Motion::Zero();
    Eigen::MatrixXd with_parameters;  // 6 x n
  };
  std::vector<Suffix> suffix(pieces.size() + 1);
  suffix.back().with_parameters = Eigen::MatrixXd::Zero(6, n);
  CondensedSum of_segment = CondensedSum::Zero();
  for (std::size_t p = pieces.size(); p-- > 0;) {
    const std::size_t k = pieces[p].segment;
    const auto& segment = segments[k];
    const CondensedSum sum = SumOfRows(pieces[p].points, frames[k], r, wide_sigma_mm);
    const MotionMap map = ToFrame(segment, origin);
    suffix[p].information =
        suffix[p + 1].information + map.transpose() * sum.topLeftCorner<6, 6>() * map;
    suffix[p].slope = suffix[p + 1].slope + map.transpose() * sum.block<6, 1>(0, kLocalState);
    suffix[p].with_parameters =
        suffix[p + 1].with_parameters +
        map.transpose() * sum.topLeftCorner<6, kLocalState>() * derivatives[k];
    of_segment += sum;
    if (p > 0 && pieces[p - 1].segment == k) continue;
    information += derivatives[k].transpose() *
                   of_segment.topLeftCorner<kLocalState, kLocalState>() * derivatives[k];
    slope += derivatives[k].transpose() * of_segment.block<kLocalState, 1>(0, kLocalState);
    of_segment.setZero();
  }
  slope = -slope;
  fit.priors.Add(parameters, parameters.Initial(), fit.sigma_mm, information, slope);
  slope = -slope;
  // Where the samples leave something open the parameters are believed to be nearly right: what
  // takes them far away, where linear means nothing, is no gain.
  const auto believe = [&](int i, double range) {
    if (i >= 0) information(i, i) += fit.sigma_mm * fit.sigma_mm / (range * range);
  };
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    believe(parameters.length(i), kRange * r);
    believe(parameters.rotation(i), kRangeRad);
    believe(parameters.angle(i), kRangeRad);
    believe(parameters.bend_radius(i), kRange * r);
  }
  Eigen::VectorXd scale = information.diagonal().cwiseSqrt();
  for (double& s : scale) s = s > 0 ? 1.0 / s : 0.0;
  // A straight of nothing cannot become shorter, whatever is asked for.
  for (std::size_t i = 0; i < parameters.bends(); ++i) {
    const int length = parameters.length(i);
    if (fit.tube.program.rows[i].length_mm < kNoLength && slope[length] > 0) scale[length] = 0;
  }
  Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
  scaled.diagonal().array() += 1e-9;
  const Eigen::LLT<Eigen::MatrixXd> solver(scaled);
  const auto solve = [&](const Eigen::MatrixXd& right) -> Eigen::MatrixXd {
    return scale.asDiagonal() * solver.solve(scale.asDiagonal() * right);
  };
  const Eigen::VectorXd at_rest = solve(slope);

  // What may stand at each place, and what the parameters, which would give way, make of it.
  struct Place {
    std::size_t piece;
    Modes modes;
    Eigen::Index column;  // the first of its columns
  };
  const double total_mm = segments.back().from_start_mm + segments.back().length_mm;
  const double margin_mm = kEnd * fit.tube.pipe_radius_mm;
  std::vector<Place> places;
  Eigen::Index columns = 0;
  for (std::size_t p = 1; p < pieces.size(); ++p) {
    const auto& segment = segments[pieces[p].segment];
    const double place_mm = segment.from_start_mm + pieces[p].begin_mm;
    if (place_mm < margin_mm || place_mm > total_mm - margin_mm) continue;
    places.push_back({p, ModesAt(segment, pieces[p].begin_mm, origin), columns});
    columns += places.back().modes.cols();
  }
  Eigen::MatrixXd cross(n, columns);
  for (const Place& place : places) {
    cross.middleCols(place.column, place.modes.cols()).noalias() =
        suffix[place.piece].with_parameters.transpose() * place.modes;
  }
  const Eigen::MatrixXd answers = solve(cross);  // all at once: there may be hundreds
  std::vector<MissingBend> all;
  for (const auto& [p, modes, column] : places) {
    const auto of_place = cross.middleCols(column, modes.cols());
    const ModeMatrix free = modes.transpose() * suffix[p].information * modes -
                            of_place.transpose() * answers.middleCols(column, modes.cols());
    const ModeVector pull = modes.transpose() * suffix[p].slope - of_place.transpose() * at_rest;
    const ModeVector size = free.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<ModeMatrix> eigen(size.asDiagonal() * free *
                                                          size.asDiagonal());
    const ModeVector inverse =
        (eigen.eigenvalues().array() > 1e-3)
            .select(eigen.eigenvalues().cwiseMax(kNegligible).cwiseInverse(), 0.0);
    const ModeVector step = -(size.asDiagonal() * eigen.eigenvectors() * inverse.asDiagonal() *
                              eigen.eigenvectors().transpose() * size.asDiagonal() * pull);
    MissingBend bend{pieces[p].segment, pieces[p].begin_mm, Eigen::Vector3d::Zero(), 0, 0};
    const bool arc = modes.cols() == kArcModes;
    for (Eigen::Index m = 0; m < (arc ? 3 : 2); ++m)
      bend.turn_rad += step[m] * modes.col(m).tail<3>();
    if (arc) bend.stretch_mm = step[3];
    bend.gain = -step.dot(pull) / (fit.sigma_mm * fit.sigma_mm * fit.design_effect);
    all.push_back(bend);
  }
  std::vector<MissingBend> standing_out;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool before = i == 0 || all[i].gain >= all[i - 1].gain;
    const bool after = i + 1 == all.size() || all[i].gain > all[i + 1].gain;
    if (before && after) standing_out.push_back(all[i]);
  }
  std::stable_sort(standing_out.begin(), standing_out.end(),
                   [](const auto& a, const auto& b) { return a.gain > b.gain; });
  return standing_out;
}

}  // namespace bendloop::pipeline
