// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_along.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/tube/alignment.h"
#include "pipeline/tube/part_variation.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

constexpr double kRadians = std::numbers::pi / 180.0;
constexpr int kSteps = 15;
constexpr std::size_t kEnoughNodes = 300;
constexpr double kNodeSigma = 0.1;        // of r_P
constexpr double kUsualBendRadius = 3.0;  // of r_P, where the nominal names none
constexpr double kLeastAngleDeg = 0.1;
constexpr double kMissing = 0.5;  // of the nominal's angle: less is no bend that springback left
constexpr double kSure = 2.0;     // sigma
// Of the variations that PartVariation expects. More strict than where the question is only
// from which end a tube was measured.
constexpr double kWorst = 3.5, kRms = 1.5;

// A node and the place of the spine that it belongs to.
struct Foot {
  Eigen::Vector3d node_mm;
  double along_mm = 0;  // of the whole spine
};

const hal::SpineSegment& SegmentAt(std::span<const hal::SpineSegment> segments, double along_mm) {
  std::size_t k = 0;
  while (k + 1 < segments.size() && along_mm > segments[k + 1].from_start_mm) ++k;
  return segments[k];
}

class NominalAlongNodes {
 public:
  NominalAlongNodes(const hal::BendProgram& nominal, double pipe_radius_mm,
                    const SpinePolygon& polygon)
      : sigma_mm_(kNodeSigma * pipe_radius_mm) {
    tube_.pipe_radius_mm = pipe_radius_mm;
    tube_.program = nominal;
    for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
      auto& radius_mm = tube_.program.rows[i].bend_radius_mm;
      radius_mm = std::max(radius_mm.value_or(kUsualBendRadius * pipe_radius_mm), pipe_radius_mm);
    }
    nominal_ = tube_.program;
    LayAlong(polygon);
  }

  void Fit() {
    for (int i = 0; i < kSteps; ++i) Step();
  }
  double cost() const { return cost_; }
  const hal::Tube& tube() const { return tube_; }

 private:
  // As it is, with the nodes where they are after the same part of the length.
  void LayAlong(const SpinePolygon& polygon) {
    const auto segments = hal::SpineSegments(tube_.program, hal::Pose{});
    const double stretch = hal::SpineLength(tube_.program) / std::max(1e-9, LengthOf(polygon));
    const std::size_t stride = StrideTo(polygon.size(), kEnoughNodes);
    std::vector<Eigen::Vector3d> nodes, places;
    double along_mm = 0;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      if (i > 0) along_mm += (polygon[i].position_mm - polygon[i - 1].position_mm).norm();
      if (i % stride != 0) continue;
      feet_.push_back({polygon[i].position_mm, along_mm * stretch});
      const hal::SpineSegment& segment = SegmentAt(segments, feet_.back().along_mm);
      nodes.push_back(polygon[i].position_mm);
      places.push_back(segment.PointAt(feet_.back().along_mm - segment.from_start_mm));
    }
    tube_.X_WT = BestFit(nodes, places, std::vector<double>(nodes.size(), 1.0)).X_NW.Inverse();
  }

  // Gauss-Newton; then the feet slide to where the nodes now are.
  void Step() {
    const auto segments = hal::SpineSegments(tube_.program, tube_.X_WT);
    const TubeParameters parameters(tube_, false);
    const auto derivatives = parameters.FrameDerivatives(segments);
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(parameters.size(), parameters.size());
    Eigen::VectorXd right = Eigen::VectorXd::Zero(parameters.size());
    cost_ = 0;
    for (Foot& foot : feet_) AddNode(segments, derivatives, foot, matrix, right);
    AddPrior(parameters, matrix, right);
    matrix.diagonal().array() += 1e-9 * matrix.diagonal().maxCoeff();
    tube_ = parameters.TubeAt(parameters.Initial() + matrix.ldlt().solve(right));
    for (std::size_t i = 0; i < tube_.program.bend_count(); ++i) {
      hal::BendRow& row = tube_.program.rows[i];
      row.length_mm = std::max(0.0, row.length_mm);
      row.angle_deg = std::max(kLeastAngleDeg, row.angle_deg);
      row.bend_radius_mm = std::max(tube_.pipe_radius_mm, *row.bend_radius_mm);
    }
  }

  void AddNode(const std::vector<hal::SpineSegment>& segments,
               const std::vector<Eigen::MatrixXd>& derivatives, Foot& foot, Eigen::MatrixXd& matrix,
               Eigen::VectorXd& right) {
    const hal::SpineSegment& segment = SegmentAt(segments, foot.along_mm);
    const auto k = static_cast<std::size_t>(&segment - segments.data());
    const double along_mm = foot.along_mm - segment.from_start_mm;
    const Eigen::Vector3d place = segment.PointAt(along_mm);
    const Eigen::Matrix3d axes = segment.axes();  // of the local state: surface_sums.h
    const Eigen::Vector3d p = axes.transpose() * (place - segment.start_mm);
    const Eigen::Vector3d t = axes.transpose() * segment.TangentAt(along_mm);
    const Eigen::Vector3d off = axes.transpose() * (foot.node_mm - place);
    Eigen::Matrix<double, 3, 7> of_state;  // velocity, angular velocity, bend radius
    of_state.leftCols<3>().setIdentity();
    of_state.middleCols<3>(3) << 0, p.z(), -p.y(), -p.z(), 0, p.x(), p.y(), -p.x(), 0;
    of_state.col(6).setZero();
    if (segment.is_arc()) of_state.col(6) = p / segment.bend_radius_mm;
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - t * t.transpose();
    const Eigen::Matrix<double, 3, Eigen::Dynamic> row =
        across * of_state * derivatives[k].topRows<7>() / sigma_mm_;
    const Eigen::Vector3d distance = across * off / sigma_mm_;
    matrix.noalias() += row.transpose() * row;
    right.noalias() += row.transpose() * distance;
    cost_ += distance.squaredNorm();
    foot.along_mm += t.dot(off);
  }

  void AddPrior(const TubeParameters& parameters, Eigen::MatrixXd& matrix, Eigen::VectorXd& right) {
    const auto add = [&](int i, double deviation, double sigma) {
      matrix(i, i) += 1.0 / (sigma * sigma);
      right[i] -= deviation / (sigma * sigma);
      cost_ += deviation * deviation / (sigma * sigma);
    };
    for (std::size_t i = 0; i < parameters.bends(); ++i) {
      const hal::BendRow& is = tube_.program.rows[i];
      const hal::BendRow& was = nominal_.rows[i];
      const hal::BendRow sigma = ExpectedVariation(nominal_, i, {});
      add(parameters.length(i), is.length_mm - was.length_mm, sigma.length_mm);
      add(parameters.angle(i), (is.angle_deg - was.angle_deg) * kRadians,
          kRadians * sigma.angle_deg);
      add(parameters.bend_radius(i), *is.bend_radius_mm - *was.bend_radius_mm,
          *sigma.bend_radius_mm);
      if (i == 0) continue;
      add(parameters.rotation(i),
          hal::WrapRotationDeg(is.rotation_deg - was.rotation_deg) * kRadians,
          kRadians * sigma.rotation_deg);
    }
  }

  hal::Tube tube_;
  hal::BendProgram nominal_;
  std::vector<Foot> feet_;
  double sigma_mm_;
  double cost_ = 0;  // before the last step
};

}  // namespace

hal::Tube NominalAlong(const hal::BendProgram& nominal, double pipe_radius_mm,
                       const SpinePolygon& polygon) {
  NominalAlongNodes forward(nominal, pipe_radius_mm, polygon);
  forward.Fit();
  NominalAlongNodes reverse(ReverseProgram(nominal), pipe_radius_mm, polygon);
  reverse.Fit();
  return forward.cost() <= reverse.cost() ? forward.tube() : reverse.tube();
}

bool MayBe(const hal::BendProgram& nominal, const hal::Tube& tube, const hal::BendProgram& sigma) {
  if (nominal.bend_count() != tube.program.bend_count()) return false;
  const auto fits = [&nominal](hal::BendProgram program, const hal::BendProgram& one_sigma) {
    program.rows.front().length_mm = nominal.rows.front().length_mm;
    program.rows.back().length_mm = nominal.rows.back().length_mm;
    for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
      const double most_deg = program.rows[i].angle_deg + kSure * one_sigma.rows[i].angle_deg;
      if (most_deg < kMissing * nominal.rows[i].angle_deg) return false;
    }
    hal::BendProgram of_radii = one_sigma;  // the others are known, or would hide what they are
    for (hal::BendRow& row : of_radii.rows) row = {0, 0, 0, row.bend_radius_mm};
    const DirectionMatch match = MatchDirection(nominal, program, of_radii, {});
    return match.forward.worst <= kWorst && match.forward.rms <= kRms;
  };
  return fits(tube.program, sigma) || fits(ReverseProgram(tube.program), ReverseProgram(sigma));
}

}  // namespace bendloop::pipeline
