// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/registration.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "hal/angles.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

constexpr int kOffset = 6;                                        // of a pass: move, turn
constexpr int kRound = 8;                                         // local state without flattening
using LocalRow = Eigen::Matrix<double, kRound + kOffset + 1, 1>;  // and the distance
using LocalSum = Eigen::Matrix<double, kRound + kOffset + 1, kRound + kOffset + 1>;
// The same on and below the diagonal, with what fills whole registers.
constexpr int kRowRoom = 16;
using RowSum = Eigen::Matrix<double, kRowRoom, kRound + kOffset + 1>;

struct RegistrationSettings {
  // So many points tell by how much passes do not meet.
  std::size_t points = 24'000;
  // So many tell that passes meet, as they mostly do.
  std::size_t first_points = 6'000;
  // Fewer in a pass tell nothing of it.
  std::size_t least_points = 200;
  // Steps: the offsets are small, so the second hardly moves anything.
  int steps = 3;
  // [sigma] From which on the samples insist that the passes do not meet.
  double insist = 5.0;
  // Times that the sum of squares must be without the offsets: noise that grows at grazing
  // incidence looks a little like passes that do not meet.
  double worth = 1.1;
};
constexpr RegistrationSettings kRegistration;

// What a point says.
struct PassRow {
  LocalRow row;
  std::int32_t segment;
  unsigned pass;
};

// `row`: kRowRoom numbers.
BENDLOOP_LOOP void AddRowBody(const double* row, double weight, double* sum) {
  for (int k = 0; k < LocalRow::SizeAtCompileTime; ++k) {
    const double weighted = weight * row[k];
    for (int i = k / 4 * 4; i < kRowRoom; ++i) sum[kRowRoom * k + i] += weighted * row[i];
  }
}
BENDLOOP_MULTIVERSION(void, AddRow, (const double* row, double weight, double* sum),
                      (row, weight, sum))

struct PassPoint {
  Eigen::Vector3d place_mm;
  unsigned pass;
};
// Those of a block.
struct PassBlock {
  Eigen::Vector3d center_mm;
  double half_diagonal_mm;
  std::size_t begin, end;
};

// What the points say of the tube's parameters and the passes' offsets.
struct Joint {
  Eigen::MatrixXd matrix;
  Eigen::VectorXd right;
  double squares = 0, weight = 0, sigma_mm = 0, robust = 0;
};

// The derivative of a point's distance by its segment's local state (surface_sums.cc) and the
// direction out of the surface, in the world.
double LocalDerivative(const SegmentFrame& frame, double pipe_radius_mm, const Eigen::Vector3d& p,
                       LocalRow& row, Eigen::Vector3d& outward) {
  const Eigen::Vector3d v = p - frame.start_mm;
  const double x = v.dot(frame.tangent), y = v.dot(frame.across), z = v.dot(frame.normal);
  if (frame.bend_radius_mm <= 0) {
    const double rho = std::max(1e-9, std::hypot(y, z));
    const double oy = y / rho, oz = z / rho;
    row.head<kRound>() << 0, -oy, -oz, 0, x * oz, -x * oy, 0, -1;
    outward = oy * frame.across + oz * frame.normal;
    return rho - pipe_radius_mm;
  }
  const double R = frame.bend_radius_mm;
  const double rho = std::max(1e-9, std::hypot(x, y - R));
  const double a = x / rho, b = (y - R) / rho, u = rho - R;
  const double distance = std::max(1e-9, std::hypot(u, z));
  const double c = u / distance, s = z / distance;
  row.head<kRound>() << -c * a, -c * b, -s, -R * (s + s * b), R * s * a, R * c * a, -c * b - c, -1;
  outward = c * (a * frame.tangent + b * frame.across) + s * frame.normal;
  return distance - pipe_radius_mm;
}

class PassFit {
 public:
  PassFit(const SurfaceFit& fit, unsigned passes, const PassDrift& drift, double reach_mm,
          std::span<const PointBlock> blocks, std::size_t points)
      : fit_(fit),
        reach_mm_(reach_mm),
        passes_(static_cast<int>(passes)),
        offsets_(Eigen::VectorXd::Zero(kOffset * passes_)) {
    sigmas_.resize(kOffset);
    sigmas_ << Eigen::Vector3d::Constant(drift.move_mm),
        Eigen::Vector3d::Constant(drift.turn_deg / hal::kDegreesPerRadian);
    Take(blocks, points);
  }

  std::size_t PassesWithPoints() const {
    return static_cast<std::size_t>(std::count_if(count_.begin(), count_.end(), [](std::size_t n) {
      return n >= kRegistration.least_points;
    }));
  }
  const Eigen::Vector3d& middle_mm() const { return middle_mm_; }
  Eigen::VectorXd Offset(unsigned pass) const {
    return offsets_.segment<kOffset>(kOffset * static_cast<int>(pass));
  }
  Eigen::Vector3d Moved(const Eigen::Vector3d& p, unsigned pass) const {
    const int at = kOffset * static_cast<int>(pass);
    const Eigen::Vector3d turn = offsets_.segment<3>(at + 3);
    return p + offsets_.segment<3>(at) + turn.cross(p - middle_mm_);
  }

  // Whether the first step makes the sum of squares so little less that further ones, which hardly
  // move anything, will not make it less by as much as is asked for.
  bool IsInVain() {
    const Joint joint = Start();
    const double before = joint.robust * joint.sigma_mm * joint.sigma_mm;
    if (!MoveOn(joint)) return true;
    const double after = SquaresMm2();
    return before < 0.5 * (1.0 + kRegistration.worth) * after;
  }

  // True: the samples insist on the offsets.
  bool Solve() {
    Joint joint = Start();
    for (int i = 0; i < kRegistration.steps; ++i) {
      if (!Step(joint)) return false;
    }
    const TubeParameters parameters(tube_, true, {}, easing_);
    // Both at the noise that is left, which tells more than the noise with the offsets in it.
    const TubeParameters first(fit_.tube, true, {}, fit_.easing);
    const Eigen::VectorXd offsets = offsets_;
    offsets_.setZero();
    const Joint without =
        Linearize(first, SpineOf(fit_.tube.program, fit_.tube.X_WT, fit_.easing), joint.sigma_mm);
    offsets_ = offsets;
    const double insist =
        kRegistration.insist * kRegistration.insist + static_cast<double>(offsets_.size());
    SetCovariance(joint, parameters);
    return without.robust - joint.robust > insist * fit_.design_effect &&
           without.robust > kRegistration.worth * joint.robust;
  }
  // What the offsets add to that of the parameters.
  const Eigen::MatrixXd& covariance() const { return covariance_; }

 private:
  Joint Start() {
    tube_ = fit_.tube;
    easing_ = fit_.easing;
    offsets_.setZero();
    return Linearize(TubeParameters(tube_, true, {}, easing_),
                     SpineOf(tube_.program, tube_.X_WT, easing_), 0);
  }
  // To where the points ask to go, and what they say there. False: nowhere.
  bool Step(Joint& joint) {
    if (!MoveOn(joint)) return false;
    joint = Linearize(TubeParameters(tube_, true, {}, easing_),
                      SpineOf(tube_.program, tube_.X_WT, easing_), 0);
    return true;
  }
  bool MoveOn(const Joint& joint) {
    const TubeParameters parameters(tube_, true, {}, easing_);
    const Eigen::VectorXd step = SolveSymmetric(joint.matrix, joint.right);
    if (!step.allFinite()) return false;
    const FitBounds bounds(TubeParameters(fit_.tube, true, {}, fit_.easing),
                           fit_.tube.pipe_radius_mm, 1e6);
    const Eigen::VectorXd to = bounds.Inside(parameters.Initial() + step.head(parameters.size()));
    tube_ = parameters.TubeAt(to);
    easing_ = parameters.EasingAt(to);
    offsets_ += step.tail(offsets_.size());
    return true;
  }

  void Take(std::span<const PointBlock> blocks, std::size_t points) {
    const std::size_t stride = StrideTo(CountPoints(blocks), points);
    count_.assign(static_cast<std::size_t>(passes_), 0);
    middle_mm_.setZero();
    std::size_t next = 0;
    for (const PointBlock& block : blocks) {
      const std::size_t begin = points_.size();
      for (; next < block.points.size(); next += stride) {
        if (next >= block.to_sensor.size() || !block.to_sensor[next].known()) continue;
        const unsigned pass = PassOf(block.to_sensor[next]);
        if (pass >= static_cast<unsigned>(passes_)) continue;
        points_.push_back({block.points[next], pass});
        middle_mm_ += block.points[next];
        ++count_[pass];
      }
      next -= block.points.size();
      if (points_.size() > begin) {
        blocks_.push_back({block.center_mm, block.half_diagonal_mm, begin, points_.size()});
      }
    }
    if (!points_.empty()) middle_mm_ /= static_cast<double>(points_.size());
  }

  // How far the offsets move any point at most.
  double MostMovedMm() const {
    double furthest_mm = 0, most_mm = 0;
    for (const PassBlock& block : blocks_) {
      furthest_mm =
          std::max(furthest_mm, (block.center_mm - middle_mm_).norm() + block.half_diagonal_mm);
    }
    for (int at = 0; at < offsets_.size(); at += kOffset) {
      most_mm = std::max(most_mm, offsets_.segment<3>(at).norm() +
                                      offsets_.segment<3>(at + 3).norm() * furthest_mm);
    }
    return most_mm;
  }

  // Calls `take` with the frame, its number, the moved point and its pass.
  template <class Take>
  void ForEachNear(const EasedSpine& spine, double r_mm, Take take) const {
    const auto frames = SegmentFrames(spine, kBeyond * r_mm, {});
    const double near_mm = r_mm + reach_mm_ + MostMovedMm();
    std::vector<std::int32_t> candidates;
    for (const PassBlock& block : blocks_) {
      CandidateSegments({block.center_mm, block.half_diagonal_mm, {}}, frames, near_mm, candidates);
      for (std::size_t i = block.begin; i < block.end; ++i) {
        const Eigen::Vector3d p = Moved(points_[i].place_mm, points_[i].pass);
        const NearSegment near = NearestSegment(p, frames, candidates);
        if (near.segment < 0 || !(std::abs(near.distance_mm - r_mm) < reach_mm_)) continue;
        const auto k = static_cast<std::size_t>(near.segment);
        // The sections of bends that are not round tell of them and not of passes.
        if (!fit_.flattening.empty() && !spine.is_line(k)) continue;
        take(frames[k], near.segment, p, points_[i].pass);
      }
    }
  }

  static double SigmaOf(const std::vector<double>& magnitudes) {
    return std::max(1e-4, 1.4826 * Median(magnitudes));
  }

  // Of the distances where the fit has come to, as Linearize() sums them.
  double SquaresMm2() const {
    const double r_mm = tube_.pipe_radius_mm;
    std::vector<double> magnitudes;
    magnitudes.reserve(points_.size());
    LocalRow row;
    Eigen::Vector3d outward;
    ForEachNear(SpineOf(tube_.program, tube_.X_WT, easing_), r_mm,
                [&](const SegmentFrame& frame, std::int32_t, const Eigen::Vector3d& p, unsigned) {
                  magnitudes.push_back(std::abs(LocalDerivative(frame, r_mm, p, row, outward)));
                });
    const double sigma_mm = SigmaOf(magnitudes);
    double robust = 0;
    for (const double d : magnitudes) robust += RobustSum(d, sigma_mm);
    return (robust + OffsetsCost()) * sigma_mm * sigma_mm;
  }

  // Of the offsets' own sigmas.
  double OffsetsCost() const {
    double cost = 0;
    for (int i = 0; i < offsets_.size(); ++i) {
      cost += offsets_[i] * offsets_[i] / (sigmas_[i % kOffset] * sigmas_[i % kOffset]);
    }
    return cost;
  }

  // `sigma_mm`: the noise that gives the weights; 0: that of these distances.
  Joint Linearize(const TubeParameters& parameters, const EasedSpine& spine,
                  double sigma_mm) const {
    const double r_mm = parameters.Initial()[parameters.pipe_radius()];
    std::vector<PassRow> rows;
    rows.reserve(points_.size());
    std::vector<double> magnitudes;
    magnitudes.reserve(points_.size());
    ForEachNear(spine, r_mm,
                [&](const SegmentFrame& frame, std::int32_t segment, const Eigen::Vector3d& p,
                    unsigned pass) {
                  PassRow& row = rows.emplace_back();
                  Eigen::Vector3d outward;
                  row.row[kRound + kOffset] = LocalDerivative(frame, r_mm, p, row.row, outward);
                  row.row.segment<3>(kRound) = outward;
                  row.row.segment<3>(kRound + 3) = (p - middle_mm_).cross(outward);
                  row.segment = segment;
                  row.pass = pass;
                  magnitudes.push_back(std::abs(row.row[kRound + kOffset]));
                });
    Joint joint;
    joint.sigma_mm = sigma_mm > 0 ? sigma_mm : SigmaOf(magnitudes);
    std::vector<RowSum> sums(spine.segments.size() * static_cast<std::size_t>(passes_),
                             RowSum::Zero());
    std::array<double, kRowRoom> room{};
    for (const PassRow& row : rows) {
      const double d = row.row[kRound + kOffset];
      const double weight = RobustWeight(d, joint.sigma_mm);
      joint.robust += RobustSum(d, joint.sigma_mm);
      joint.weight += weight;
      joint.squares += weight * d * d;
      if (weight <= 0) continue;
      RowSum& sum = sums[static_cast<std::size_t>(row.segment) * static_cast<std::size_t>(passes_) +
                         row.pass];
      std::copy_n(row.row.data(), row.row.size(), room.begin());
      AddRow(room.data(), weight, sum.data());
    }
    Assemble(parameters, spine, sums, joint);
    return joint;
  }

  void Assemble(const TubeParameters& parameters, const EasedSpine& spine,
                const std::vector<RowSum>& sums, Joint& joint) const {
    const int n = parameters.size(), all = n + static_cast<int>(offsets_.size());
    const auto derivatives = parameters.FrameDerivatives(spine);
    joint.matrix = Eigen::MatrixXd::Zero(all, all);
    joint.right = Eigen::VectorXd::Zero(all);
    for (std::size_t k = 0; k < derivatives.size(); ++k) {
      const Eigen::MatrixXd to_tube = derivatives[k].topRows<kRound>().transpose();
      LocalSum of_segment = LocalSum::Zero();
      for (int pass = 0; pass < passes_; ++pass) {
        const LocalSum sum =
            sums[k * static_cast<std::size_t>(passes_) + static_cast<std::size_t>(pass)]
                .topRows<LocalSum::RowsAtCompileTime>()
                .selfadjointView<Eigen::Lower>();
        if (sum(kRound - 1, kRound - 1) == 0) continue;
        of_segment += sum;
        // An offset is what it is: only what it has to do with the tube is mapped.
        const int at = n + kOffset * pass;
        joint.matrix.block<kOffset, kOffset>(at, at) += sum.block<kOffset, kOffset>(kRound, kRound);
        const Eigen::MatrixXd both = Product(to_tube, sum.block<kRound, kOffset>(0, kRound));
        joint.matrix.block(0, at, n, kOffset) += both;
        joint.matrix.block(at, 0, kOffset, n) += both.transpose();
        joint.right.segment<kOffset>(at) -= sum.col(kRound + kOffset).segment<kOffset>(kRound);
      }
      joint.matrix.topLeftCorner(n, n) +=
          Mapped(to_tube, of_segment.topLeftCorner<kRound, kRound>());
      joint.right.head(n) -= to_tube * of_segment.col(kRound + kOffset).head<kRound>();
    }
    fit_.priors.Add(parameters, parameters.Initial(), joint.sigma_mm, joint.matrix, joint.right);
    // What no point feels stays where it is.
    const Eigen::VectorXd range = ExpectedRange(parameters, fit_.tube.pipe_radius_mm);
    const double variance = joint.sigma_mm * joint.sigma_mm;
    for (int i = 0; i < n; ++i) {
      joint.matrix(i, i) += std::isfinite(range[i]) ? variance / (range[i] * range[i]) : 1e-12;
    }
    const double of_offsets = variance * fit_.design_effect;
    for (int i = 0; i < offsets_.size(); ++i) {
      const double certainty = of_offsets / (sigmas_[i % kOffset] * sigmas_[i % kOffset]);
      joint.matrix(n + i, n + i) += certainty;
      joint.right[n + i] -= certainty * offsets_[i];
    }
    joint.robust += OffsetsCost();
  }

  void SetCovariance(const Joint& joint, const TubeParameters& parameters) {
    const int n = parameters.size();
    const auto offsets = static_cast<int>(offsets_.size());
    const double variance = joint.squares / std::max(1.0, joint.weight);
    // As a product, and not as the difference of the parameters' covariances with offsets and
    // without: what points hardly tell of a bend (a slight one) is as large in both, and would
    // leave less than nothing.
    const Eigen::MatrixXd both = joint.matrix.topRightCorner(n, offsets);
    const Eigen::MatrixXd moves = SolveSymmetric(joint.matrix.topLeftCorner(n, n), both);
    const EigenSystem of_offsets =
        SymmetricEigen(joint.matrix.bottomRightCorner(offsets, offsets) - both.transpose() * moves);
    const double least = joint.sigma_mm * joint.sigma_mm * fit_.design_effect /
                         std::pow(sigmas_.maxCoeff(), 2);  // what their priors alone tell of them
    const Eigen::VectorXd known = of_offsets.values.cwiseMax(least);
    const Eigen::MatrixXd root =
        moves * of_offsets.vectors * known.cwiseSqrt().cwiseInverse().asDiagonal();
    covariance_ = variance * root * root.transpose();
  }

  const SurfaceFit& fit_;
  double reach_mm_;
  int passes_;
  hal::Tube tube_;  // where the fit has come to
  Easing easing_;
  Eigen::VectorXd offsets_, sigmas_;
  std::vector<PassPoint> points_;
  std::vector<PassBlock> blocks_;
  std::vector<std::size_t> count_;
  Eigen::Vector3d middle_mm_ = Eigen::Vector3d::Zero();
  Eigen::MatrixXd covariance_;
};

void CountOfPasses(std::span<const PointBlock> blocks, Registration& registration) {
  for (const PointBlock& block : blocks) {
    for (const SensorDirection to_sensor : block.to_sensor) {
      if (!to_sensor.known() || PassOf(to_sensor) >= registration.passes.size()) continue;
      ++registration.passes[PassOf(to_sensor)].points;
    }
  }
}

}  // namespace

Registration RegisterPasses(const SurfaceFit& fit, unsigned passes, const PassDrift& drift,
                            double reach_mm, std::vector<PointBlock>& blocks) {
  Registration registration;
  if (passes < 2) return registration;
  if (PassFit(fit, passes, drift, reach_mm, blocks, kRegistration.first_points).IsInVain()) {
    return registration;
  }
  PassFit together(fit, passes, drift, reach_mm, blocks, kRegistration.points);
  if (together.PassesWithPoints() < 2 || !together.Solve()) return registration;
  registration.middle_mm = together.middle_mm();
  registration.covariance = together.covariance();
  for (unsigned pass = 0; pass < passes; ++pass) {
    const Eigen::VectorXd offset = together.Offset(pass);
    registration.passes.push_back({0, offset.head<3>(), offset.tail<3>() * hal::kDegreesPerRadian});
  }
  CountOfPasses(blocks, registration);
  MoveOntoTube(registration, blocks, registration.points);
  return registration;
}

Eigen::Vector3d Registration::Moved(const Eigen::Vector3d& point, SensorDirection to_sensor) const {
  if (!to_sensor.known() || PassOf(to_sensor) >= passes.size()) return point;
  const PassOffset& offset = passes[PassOf(to_sensor)];
  const Eigen::Vector3d turn = offset.turn_deg * hal::kRadiansPerDegree;
  return point + offset.move_mm + turn.cross(point - middle_mm);
}

void MoveOntoTube(const Registration& registration, std::vector<PointBlock>& blocks,
                  std::vector<Eigen::Vector3d>& moved) {
  moved.reserve(CountPoints(blocks));
  for (PointBlock& block : blocks) {
    const std::size_t first = moved.size();
    double most_mm = 0;
    for (std::size_t i = 0; i < block.points.size(); ++i) {
      const bool knows = i < block.to_sensor.size();
      const Eigen::Vector3d& from = block.points[i];
      moved.push_back(registration.Moved(from, knows ? block.to_sensor[i] : SensorDirection{}));
      most_mm = std::max(most_mm, (moved.back() - from).norm());
    }
    block.points = std::span(moved).subspan(first);
    block.half_diagonal_mm += most_mm;
  }
}

}  // namespace bendloop::pipeline
