// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/nominal_along.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/tube/alignment.h"
#include "pipeline/tube/part_variation.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

// What the nominal is bent by, and what is still it. Chosen by trial where nothing else is said.
struct NominalSettings {
  // So many nodes at most, evenly along the spine: more say the same of some rows.
  std::size_t enough_nodes = 300;
  // [of r_P] 1 sigma of a node across the spine.
  double node_sigma = 0.1;
  // [of r_P] Of a bend of which the nominal does not say it: common dies bend that wide.
  double usual_bend_radius = 3.0;
  // [degrees] A bend of nothing has no plane.
  double least_angle_deg = 0.1;
  // Of Ceres; usually a few are enough.
  int most_steps = 30;
  // Of the nominal's angle: less is no bend that springback left.
  double missing = 0.5;
  // [sigma] A bend is missing for certain when this much more is too little still.
  double sure_sigmas = 2.0;
  // [of the variations that PartVariation expects] The greatest and the root mean square. More
  // strict than where the question is only from which end a tube was measured.
  double worst = 3.5, rms = 1.5;
  // [degrees] The corner of a wider bend is too far away to count from.
  double widest_corner_deg = 150.0;
};
constexpr NominalSettings kNominal;

// A node and the place of the spine that it belongs to.
struct Foot {
  Eigen::Vector3d node_mm;
  double along_mm = 0;  // of the whole spine
};

// A tube as the numbers that Ceres moves: where it starts (position [mm], quaternion), then length,
// rotation, angle and radius of each bend as in the program [mm, degrees].
constexpr std::size_t kOfStart = 7, kOfBend = 4;

std::vector<double> NumbersOf(const hal::Tube& tube) {
  const Eigen::Vector3d& p = tube.X_WT.position_mm;
  const Eigen::Quaterniond& q = tube.X_WT.orientation;
  std::vector<double> numbers = {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z()};
  for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
    const hal::BendRow& row = tube.program.rows[i];
    for (const double value :
         {row.length_mm, row.rotation_deg, row.angle_deg, row.bend_radius_mm.value_or(0.0)}) {
      numbers.push_back(value);
    }
  }
  return numbers;
}

// `like`: what no number says, its pipe radius and last length.
hal::Tube TubeOf(const double* numbers, const hal::Tube& like) {
  hal::Tube tube = like;
  tube.X_WT.position_mm = {numbers[0], numbers[1], numbers[2]};
  tube.X_WT.orientation = {numbers[3], numbers[4], numbers[5], numbers[6]};
  for (std::size_t i = 0; i < tube.program.bend_count(); ++i) {
    const double* row = numbers + kOfStart + kOfBend * i;
    tube.program.rows[i] = {row[0], row[1], row[2], row[3]};
  }
  return tube;
}

// Row-major, as Ceres wants them.
using Jacobian = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Steps of Ceres are those of TubeParameters about the tube as it is. Costs say how they change by
// the step in the first of their columns and leave the others zero.
class TubeSteps final : public ceres::Manifold {
 public:
  explicit TubeSteps(const hal::Tube& like)
      : like_(like),
        numbers_(static_cast<int>(NumbersOf(like).size())),
        steps_(TubeParameters(like, false).size()) {}
  int AmbientSize() const override { return numbers_; }
  int TangentSize() const override { return steps_; }
  bool Plus(const double* numbers, const double* step, double* moved) const override {
    const TubeParameters parameters(TubeOf(numbers, like_), false);
    const Eigen::Map<const Eigen::VectorXd> by(step, steps_);
    const auto after = NumbersOf(parameters.TubeAt(parameters.Initial() + by));
    std::copy(after.begin(), after.end(), moved);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Jacobian>(jacobian, numbers_, steps_).setIdentity();
    return true;
  }
  // Solving asks for no step between two tubes.
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  const hal::Tube& like_;
  int numbers_, steps_;
};

// The nominal on its way along the nodes, as all costs look at it. The nodes' feet slide along the
// spine with every change, so that Ceres sees the distances to it.
class NominalOnNodes final : public ceres::EvaluationCallback {
 public:
  NominalOnNodes(const hal::BendProgram& nominal, double pipe_radius_mm,
                 const SpinePolygon& polygon) {
    tube_.pipe_radius_mm = pipe_radius_mm;
    tube_.program = nominal;
    for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
      hal::BendRow& row = tube_.program.rows[i];
      row.length_mm = std::max(0.0, row.length_mm);
      row.angle_deg = std::max(kNominal.least_angle_deg, row.angle_deg);
      row.bend_radius_mm = std::max(
          row.bend_radius_mm.value_or(kNominal.usual_bend_radius * pipe_radius_mm), pipe_radius_mm);
    }
    LayAlong(polygon);
    numbers_ = NumbersOf(tube_);
  }

  std::vector<double>& numbers() { return numbers_; }
  const hal::Tube& tube() const { return tube_; }
  const std::vector<Foot>& feet() const { return feet_; }
  const std::vector<hal::SpineSegment>& segments() const { return segments_; }
  // Its end straights end where the nodes do: what lies on the line beyond is not its own.
  hal::Tube EndingAtNodes() const {
    hal::Tube tube = tube_;
    double& first_mm = tube.program.rows.front().length_mm;
    double& last_mm = tube.program.rows.back().length_mm;
    last_mm = std::max(0.0, feet_.back().along_mm - segments_.back().from_start_mm);
    const double before_mm = std::min(feet_.front().along_mm, first_mm);
    tube.X_WT.position_mm += before_mm * segments_.front().tangent;
    first_mm -= before_mm;
    return tube;
  }
  // Of every segment's frame by the step.
  const std::vector<Eigen::MatrixXd>& derivatives() const { return derivatives_; }

  void PrepareForEvaluation(bool evaluate_jacobians, bool new_evaluation_point) override {
    if (new_evaluation_point) {
      tube_ = TubeOf(numbers_.data(), tube_);
      segments_ = hal::SpineSegments(tube_.program, tube_.X_WT);
      for (Foot& foot : feet_) Slide(foot);
    }
    if (evaluate_jacobians) {
      derivatives_ = TubeParameters(tube_, false).FrameDerivatives(segments_);
    }
  }

 private:
  // As it is, with the nodes where they are after the same part of the length.
  void LayAlong(const SpinePolygon& polygon) {
    const auto segments = hal::SpineSegments(tube_.program, hal::Pose{});
    const double stretch = hal::SpineLength(tube_.program) / std::max(1e-9, LengthOf(polygon));
    const std::size_t stride = StrideTo(polygon.size(), kNominal.enough_nodes);
    std::vector<Eigen::Vector3d> nodes, places;
    double along_mm = 0;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      if (i > 0) along_mm += (polygon[i].position_mm - polygon[i - 1].position_mm).norm();
      if (i % stride != 0 && i + 1 != polygon.size()) continue;
      feet_.push_back({polygon[i].position_mm, along_mm * stretch});
      const hal::SpineSegment& segment = segments[hal::SegmentAt(segments, feet_.back().along_mm)];
      nodes.push_back(polygon[i].position_mm);
      places.push_back(segment.PointAt(feet_.back().along_mm - segment.from_start_mm));
    }
    tube_.X_WT = BestFit(nodes, places, std::vector<double>(nodes.size(), 1.0)).X_NW.Inverse();
  }

  // To where the node now is; on an arc each turn leaves a part of the way, as its distance from
  // the spine is of the bend radius.
  void Slide(Foot& foot) const {
    for (int i = 0; i < 3; ++i) {
      const hal::SpineSegment& segment = segments_[hal::SegmentAt(segments_, foot.along_mm)];
      const double along_mm = foot.along_mm - segment.from_start_mm;
      foot.along_mm += segment.TangentAt(along_mm).dot(foot.node_mm - segment.PointAt(along_mm));
    }
  }

  hal::Tube tube_;
  std::vector<double> numbers_;
  std::vector<Foot> feet_;
  std::vector<hal::SpineSegment> segments_;
  std::vector<Eigen::MatrixXd> derivatives_;
};

// How far the nodes lie off the spine, across it, in their sigma.
class NodeDistances final : public ceres::CostFunction {
 public:
  NodeDistances(const NominalOnNodes& on_nodes, int numbers) : on_nodes_(on_nodes) {
    set_num_residuals(3 * static_cast<int>(on_nodes.feet().size()));
    mutable_parameter_block_sizes()->push_back(numbers);
  }
  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const auto& segments = on_nodes_.segments();
    const double sigma_mm = kNominal.node_sigma * on_nodes_.tube().pipe_radius_mm;
    const bool derive = jacobians && jacobians[0];
    Eigen::Map<Jacobian> all(derive ? jacobians[0] : nullptr, derive ? num_residuals() : 0,
                             parameter_block_sizes()[0]);
    all.setZero();
    for (std::size_t i = 0; i < on_nodes_.feet().size(); ++i) {
      const Foot& foot = on_nodes_.feet()[i];
      const hal::SpineSegment& segment = segments[hal::SegmentAt(segments, foot.along_mm)];
      const double along_mm = foot.along_mm - segment.from_start_mm;
      const Eigen::Vector3d place = segment.PointAt(along_mm);
      const Eigen::Matrix3d axes = segment.axes();  // of the local state: surface_sums.h
      const Eigen::Vector3d t = axes.transpose() * segment.TangentAt(along_mm);
      const Eigen::Matrix3d across = (Eigen::Matrix3d::Identity() - t * t.transpose()) / sigma_mm;
      Eigen::Map<Eigen::Vector3d>(residuals + 3 * i) =
          across * axes.transpose() * (foot.node_mm - place);
      if (!derive) continue;
      const Eigen::Vector3d p = axes.transpose() * (place - segment.start_mm);
      Eigen::Matrix<double, 3, 7> of_state;  // velocity, angular velocity, bend radius
      of_state.leftCols<3>().setIdentity();
      of_state.middleCols<3>(3) << 0, p.z(), -p.y(), -p.z(), 0, p.x(), p.y(), -p.x(), 0;
      of_state.col(6).setZero();
      if (segment.is_arc()) of_state.col(6) = p / segment.bend_radius_mm;
      const auto& derivative =
          on_nodes_.derivatives()[static_cast<std::size_t>(&segment - segments.data())];
      all.block(3 * static_cast<Eigen::Index>(i), 0, 3, derivative.cols()) =
          -across * of_state * derivative.topRows<7>();
    }
    return true;
  }

 private:
  const NominalOnNodes& on_nodes_;
};

// What springback, slip and stretch have changed, in what is expected of them.
class Variations final : public ceres::CostFunction {
 public:
  Variations(const NominalOnNodes& on_nodes, int numbers)
      : on_nodes_(on_nodes), nominal_(on_nodes.tube().program) {
    set_num_residuals(static_cast<int>(kOfBend * nominal_.bend_count()));
    mutable_parameter_block_sizes()->push_back(numbers);
  }
  bool Evaluate(double const* const*, double* residuals, double** jacobians) const override {
    const TubeParameters parameters(on_nodes_.tube(), false);
    const bool derive = jacobians && jacobians[0];
    Eigen::Map<Jacobian> all(derive ? jacobians[0] : nullptr, derive ? num_residuals() : 0,
                             parameter_block_sizes()[0]);
    all.setZero();
    Eigen::Index at = 0;
    // `unit`: of the step, in those of the row.
    const auto add = [&](int parameter, double deviation, double sigma, double unit) {
      residuals[at] = parameter < 0 ? 0.0 : deviation / sigma;
      if (derive && parameter >= 0) all(at, parameter) = 1.0 / (unit * sigma);
      ++at;
    };
    for (std::size_t i = 0; i < nominal_.bend_count(); ++i) {
      const hal::BendRow& is = on_nodes_.tube().program.rows[i];
      const hal::BendRow& was = nominal_.rows[i];
      const hal::BendRow sigma = ExpectedVariation(nominal_, i, {});
      add(parameters.length(i), is.length_mm - was.length_mm, sigma.length_mm, 1.0);
      add(parameters.angle(i), is.angle_deg - was.angle_deg, sigma.angle_deg,
          hal::kRadiansPerDegree);
      add(parameters.bend_radius(i), *is.bend_radius_mm - *was.bend_radius_mm,
          *sigma.bend_radius_mm, 1.0);
      add(parameters.rotation(i), hal::WrapRotationDeg(is.rotation_deg - was.rotation_deg),
          sigma.rotation_deg, hal::kRadiansPerDegree);
    }
    return true;
  }

 private:
  const NominalOnNodes& on_nodes_;
  hal::BendProgram nominal_;
};

struct AlongNodes {
  hal::Tube tube;
  double cost = std::numeric_limits<double>::infinity();
};

AlongNodes BendAlong(const hal::BendProgram& nominal, double pipe_radius_mm,
                     const SpinePolygon& polygon) {
  NominalOnNodes on_nodes(nominal, pipe_radius_mm, polygon);
  const hal::Tube start = on_nodes.tube();
  std::vector<double>& numbers = on_nodes.numbers();
  const auto count = static_cast<int>(numbers.size());
  ceres::Problem::Options problem_options;
  problem_options.evaluation_callback = &on_nodes;
  ceres::Problem problem(problem_options);
  problem.AddParameterBlock(numbers.data(), count, new TubeSteps(start));
  problem.AddResidualBlock(new NodeDistances(on_nodes, count), nullptr, numbers.data());
  if (nominal.bend_count() > 0) {
    problem.AddResidualBlock(new Variations(on_nodes, count), nullptr, numbers.data());
  }
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    const auto row = static_cast<int>(kOfStart + kOfBend * i);
    problem.SetParameterLowerBound(numbers.data(), row, 0.0);
    problem.SetParameterLowerBound(numbers.data(), row + 2, kNominal.least_angle_deg);
    problem.SetParameterLowerBound(numbers.data(), row + 3, pipe_radius_mm);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  // LAPACK would bring the threads of its BLAS.
  options.dense_linear_algebra_library_type = ceres::EIGEN;
  options.num_threads = 1;
  options.max_num_iterations = kNominal.most_steps;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return {start};
  on_nodes.PrepareForEvaluation(false, true);
  return {on_nodes.EndingAtNodes(), summary.final_cost};
}

// The same corners, and between them bends with the nominal's radii.
hal::BendProgram WithRadiiOf(const hal::BendProgram& nominal, hal::BendProgram program) {
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    auto& radius_mm = program.rows[i].bend_radius_mm;
    const auto& wanted_mm = nominal.rows[i].bend_radius_mm;
    if (!radius_mm || !wanted_mm || program.rows[i].angle_deg > kNominal.widest_corner_deg)
      continue;
    const double longer_mm = (*radius_mm - *wanted_mm) *
                             std::tan(0.5 * program.rows[i].angle_deg * hal::kRadiansPerDegree);
    program.rows[i].length_mm += longer_mm;
    program.rows[i + 1].length_mm += longer_mm;
    radius_mm = wanted_mm;
  }
  return program;
}

// From this end.
bool IsBentFrom(const hal::BendProgram& nominal, hal::BendProgram program,
                const hal::BendProgram& sigma) {
  if (nominal.bend_count() != program.bend_count()) return false;
  program.rows.front().length_mm = nominal.rows.front().length_mm;
  program.rows.back().length_mm = nominal.rows.back().length_mm;
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    const double most_deg =
        program.rows[i].angle_deg + kNominal.sure_sigmas * sigma.rows[i].angle_deg;
    if (most_deg < kNominal.missing * nominal.rows[i].angle_deg) return false;
  }
  hal::BendProgram of_radii = sigma;  // the others are known, or would hide what they are
  for (hal::BendRow& row : of_radii.rows) row = {0, 0, 0, row.bend_radius_mm};
  const DirectionMatch match = MatchDirection(nominal, program, of_radii, {});
  return match.forward.worst <= kNominal.worst && match.forward.rms <= kNominal.rms;
}

}  // namespace

hal::Tube NominalAlong(const hal::BendProgram& nominal, double pipe_radius_mm,
                       const SpinePolygon& polygon) {
  const AlongNodes forward = BendAlong(nominal, pipe_radius_mm, polygon);
  const AlongNodes reverse = BendAlong(ReverseProgram(nominal), pipe_radius_mm, polygon);
  return forward.cost <= reverse.cost ? forward.tube : reverse.tube;
}

bool MayBe(const hal::BendProgram& nominal, const hal::Tube& tube, const hal::BendProgram& sigma) {
  return IsBentFrom(nominal, tube.program, sigma) ||
         IsBentFrom(nominal, ReverseProgram(tube.program), ReverseProgram(sigma));
}

bool MayBeByCorners(const hal::BendProgram& nominal, const hal::Tube& tube,
                    const hal::BendProgram& sigma) {
  if (nominal.bend_count() != tube.program.bend_count()) return false;
  const auto fits = [&nominal](const hal::BendProgram& program, const hal::BendProgram& one_sigma) {
    return IsBentFrom(nominal, WithRadiiOf(nominal, program), one_sigma);
  };
  return fits(tube.program, sigma) || fits(ReverseProgram(tube.program), ReverseProgram(sigma));
}

}  // namespace bendloop::pipeline
