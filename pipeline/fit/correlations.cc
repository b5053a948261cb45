// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/correlations.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

constexpr std::size_t kColumns = 4;  // values of a row, by RowValueKind

struct CorrelationSettings {
  // |coefficient| of a strong one: who knows the one value knows the other to less than half of its
  // sigma, sqrt(1 - 0.9^2) = 0.44.
  double strong = 0.9;
  // [mm, degrees] 1 sigma of a length, rotation and angle that is vague: what the interlocks refuse
  // as shipped. A bend radius is no value of a bender.
  std::array<double, kColumns> vague = {0.3, 0.3, 0.2, std::numeric_limits<double>::infinity()};
  // [degrees] 1 sigma of a rotation that is worth a word without a correlation. By trial.
  double lone_rotation_deg = 1.0;
  // Of the sigma of the worst value: what is known together is said where it is known at least
  // twice as well.
  double better = 0.5;
};
constexpr CorrelationSettings kCorrelation;

// Along the tube: a length and a rotation stand before their bend, bend b at 2 b + 1.
std::size_t PlaceOf(const RowValue& value) {
  const bool before = value.kind == RowValueKind::kLength || value.kind == RowValueKind::kRotation;
  return 2 * value.row + (before ? 0 : 1);
}

// The bends from one value to the other; those on both sides where both stand between two.
std::pair<std::size_t, std::size_t> BendsBetween(const RowValue& a, const RowValue& b,
                                                 std::size_t bends) {
  const auto [low, high] = std::minmax({PlaceOf(a), PlaceOf(b)});
  if (low == high && low % 2 == 0) return {std::max<std::size_t>(low / 2, 1) - 1, low / 2};
  return {std::min(low / 2, bends - 1), (high - 1) / 2};
}

// The covariance of the values of all rows, in mm and degrees, with what they depend on.
class RowCovariance {
 public:
  RowCovariance(const SurfaceFit& fit, const TubeParameters& parameters,
                const hal::BendProgram& sigma)
      : bends_(parameters.bends()) {
    const auto size = static_cast<Eigen::Index>(kColumns * (bends_ + 1));
    Eigen::MatrixXd by_parameter = Eigen::MatrixXd::Zero(size, parameters.size());
    Eigen::VectorXd reported = Eigen::VectorXd::Zero(size);
    for (std::size_t i = 0; i <= bends_; ++i) {
      const hal::BendRow& row = sigma.rows[i];
      reported[At(i, RowValueKind::kLength)] = row.length_mm;
      if (i == bends_) break;
      const auto set = [&](RowValueKind kind, int parameter, double unit, double of_row) {
        by_parameter(At(i, kind), parameter) = unit;
        reported[At(i, kind)] = of_row;
      };
      set(RowValueKind::kLength, parameters.length(i), 1, row.length_mm);
      if (i > 0) {
        set(RowValueKind::kRotation, parameters.rotation(i), hal::kDegreesPerRadian,
            row.rotation_deg);
      }
      set(RowValueKind::kAngle, parameters.angle(i), hal::kDegreesPerRadian, row.angle_deg);
      set(RowValueKind::kBendRadius, parameters.bend_radius(i), 1, row.bend_radius_mm.value_or(0));
    }
    // The last length ends at a border and begins where the bends lead to.
    by_parameter.row(At(bends_, RowValueKind::kLength)) = -fit.last_start.transpose();
    matrix_ = Mapped(by_parameter, fit.covariance);
    matrix_.diagonal() = matrix_.diagonal().cwiseMax(reported.cwiseAbs2());
  }

  static Eigen::Index At(std::size_t row, RowValueKind kind) {
    return static_cast<Eigen::Index>(kColumns * row + static_cast<std::size_t>(kind));
  }
  static Eigen::Index At(const RowValue& value) { return At(value.row, value.kind); }
  std::size_t bends() const { return bends_; }
  Eigen::Index size() const { return matrix_.rows(); }
  double SigmaOf(Eigen::Index i) const { return std::sqrt(matrix_(i, i)); }
  double SigmaOf(const RowValue& value) const { return SigmaOf(At(value)); }
  bool IsVague(const RowValue& value) const {
    return SigmaOf(value) > kCorrelation.vague[static_cast<std::size_t>(value.kind)];
  }
  double SigmaOf(const Eigen::VectorXd& sum) const {
    return std::sqrt(std::max(0.0, sum.dot(matrix_ * sum)));
  }
  double Coefficient(Eigen::Index i, Eigen::Index j) const {
    const double product = SigmaOf(i) * SigmaOf(j);
    return product > 0 ? std::clamp(matrix_(i, j) / product, -1.0, 1.0) : 0.0;
  }

 private:
  std::size_t bends_;
  Eigen::MatrixXd matrix_;
};

RowValue ValueAt(Eigen::Index i) {
  const auto index = static_cast<std::size_t>(i);
  return {index / kColumns, static_cast<RowValueKind>(index % kColumns)};
}

std::vector<Correlation> StrongOnes(const RowCovariance& covariance) {
  std::vector<Correlation> list;
  for (Eigen::Index i = 0; i < covariance.size(); ++i) {
    for (Eigen::Index j = i + 1; j < covariance.size(); ++j) {
      const double coefficient = covariance.Coefficient(i, j);
      if (std::abs(coefficient) < kCorrelation.strong) continue;
      list.push_back({ValueAt(i), ValueAt(j), coefficient});
    }
  }
  return list;
}

void KeepStrongest(std::vector<Correlation>& list) {
  if (list.size() <= kMostCorrelations) return;
  std::stable_sort(list.begin(), list.end(), [](const Correlation& a, const Correlation& b) {
    return std::abs(a.coefficient) > std::abs(b.coefficient);
  });
  list.resize(kMostCorrelations);
  std::sort(list.begin(), list.end(), [](const Correlation& a, const Correlation& b) {
    return std::pair(RowCovariance::At(a.first), RowCovariance::At(a.second)) <
           std::pair(RowCovariance::At(b.first), RowCovariance::At(b.second));
  });
}

// Runs of bends with values that are vague and in strong correlation, and those before which a
// rotation is vague: there it is the bend that has hardly a plane.
std::vector<KnownTogether> VagueBends(const RowCovariance& covariance,
                                      const std::vector<Correlation>& correlations) {
  std::vector<KnownTogether> list;
  const auto add = [&](const RowValue& a, const RowValue& b) {
    if (!covariance.IsVague(a) && !covariance.IsVague(b)) return;
    const auto [first, last] = BendsBetween(a, b, covariance.bends());
    list.push_back({.first_bend = first, .last_bend = last, .values = {a, b}});
  };
  for (const Correlation& c : correlations) add(c.first, c.second);
  for (std::size_t i = 1; i < covariance.bends(); ++i) {
    const RowValue rotation{i, RowValueKind::kRotation};
    if (covariance.SigmaOf(rotation) < kCorrelation.lone_rotation_deg) continue;
    list.push_back({.first_bend = i, .last_bend = i, .values = {rotation}});
  }
  std::stable_sort(list.begin(), list.end(),
                   [](const auto& a, const auto& b) { return a.first_bend < b.first_bend; });
  std::vector<KnownTogether> joined;
  for (KnownTogether& next : list) {
    if (joined.empty() || next.first_bend > joined.back().last_bend) {
      joined.push_back(std::move(next));
      continue;
    }
    KnownTogether& run = joined.back();
    run.last_bend = std::max(run.last_bend, next.last_bend);
    run.values.insert(run.values.end(), next.values.begin(), next.values.end());
  }
  for (KnownTogether& run : joined) {
    const auto before = [](const RowValue& a, const RowValue& b) {
      return RowCovariance::At(a) < RowCovariance::At(b);
    };
    std::sort(run.values.begin(), run.values.end(), before);
    run.values.erase(std::unique(run.values.begin(), run.values.end()), run.values.end());
  }
  return joined;
}

// How the frame of the straight behind the bends turns against the one before, whose plane is that
// of the bend before: 3 x parameters, in the world.
Eigen::MatrixXd TurnBehind(const KnownTogether& run, const TubeParameters& parameters,
                           const std::vector<hal::SpineSegment>& segments,
                           const std::vector<Eigen::MatrixXd>& derivatives) {
  const auto turn = [&](std::size_t k) -> Eigen::MatrixXd {
    return Product(segments[k].axes(), derivatives[k].middleRows<3>(3));
  };
  Eigen::MatrixXd before = turn(2 * run.first_bend);
  if (run.first_bend > 0) before.col(parameters.rotation(run.first_bend)).setZero();
  return turn(2 * run.last_bend + 2) - before;
}

// The greatest sigma of a turn about an axis across `tangent`.
double AcrossSigma(const Eigen::Matrix3d& turn, const Eigen::Vector3d& tangent) {
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - tangent * tangent.transpose();
  return std::sqrt(std::max(0.0, SymmetricEigen(across * turn * across).values.maxCoeff()));
}

// The greatest sigmas of a run's vague values.
struct WorstSigmas {
  double rotation_deg = 0;
  double turn_deg = 0;  // of rotations and angles
  double length_mm = 0;
};

WorstSigmas WorstOf(const KnownTogether& run, const RowCovariance& covariance) {
  WorstSigmas worst;
  for (const RowValue& value : run.values) {
    if (!covariance.IsVague(value)) continue;
    const bool is_length = value.kind == RowValueKind::kLength;
    double& of_kind = is_length ? worst.length_mm : worst.turn_deg;
    of_kind = std::max(of_kind, covariance.SigmaOf(value));
    if (value.kind == RowValueKind::kRotation) {
      worst.rotation_deg = std::max(worst.rotation_deg, covariance.SigmaOf(value));
    }
  }
  return worst;
}

// The direction in which the tube goes on behind the run and the plane of the next bend against
// the one before, where they are known. `turn`: the covariance of TurnBehind.
void SetTurn(const Eigen::Matrix3d& turn, const std::vector<hal::SpineSegment>& segments,
             std::size_t bends, const WorstSigmas& worst, KnownTogether& run) {
  const Eigen::Vector3d before = segments[2 * run.first_bend].tangent;
  const Eigen::Vector3d behind = segments[2 * run.last_bend + 2].tangent;
  // From both sides, so that it is the same for the tube from its other end.
  const double direction_deg =
      hal::kDegreesPerRadian * std::max(AcrossSigma(turn, before), AcrossSigma(turn, behind));
  if (direction_deg < kCorrelation.better * worst.turn_deg) run.direction_sigma_deg = direction_deg;
  const double plane_deg =
      hal::kDegreesPerRadian *
      std::sqrt(std::max({0.0, before.dot(turn * before), behind.dot(turn * behind)}));
  const bool between_bends = run.first_bend > 0 && run.last_bend + 1 < bends;
  if (between_bends && plane_deg < kCorrelation.better * worst.rotation_deg) {
    run.plane_sigma_deg = plane_deg;
  }
}

// The length of the spine through the run with the straights on both sides, where it is known.
void SetLength(const RowCovariance& covariance, const hal::BendProgram& measured,
               const WorstSigmas& worst, KnownTogether& run) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(covariance.size());
  double sum_mm = 0;
  for (std::size_t i = run.first_bend; i <= run.last_bend + 1; ++i) {
    const hal::BendRow& row = measured.rows[i];
    sum[RowCovariance::At(i, RowValueKind::kLength)] = 1;
    sum_mm += row.length_mm;
    if (i > run.last_bend) break;
    const double radius_mm = row.bend_radius_mm.value_or(0);
    sum[RowCovariance::At(i, RowValueKind::kAngle)] = radius_mm / hal::kDegreesPerRadian;
    sum[RowCovariance::At(i, RowValueKind::kBendRadius)] = row.angle_deg / hal::kDegreesPerRadian;
    sum_mm += radius_mm * row.angle_deg / hal::kDegreesPerRadian;
  }
  const double sigma_mm = covariance.SigmaOf(sum);
  if (!(sigma_mm < kCorrelation.better * worst.length_mm)) return;
  run.length_mm = sum_mm;
  run.length_sigma_mm = sigma_mm;
}

bool SaysNothing(const KnownTogether& run) {
  return run.values.size() == 1 && std::isnan(run.direction_sigma_deg) &&
         std::isnan(run.plane_sigma_deg);
}

}  // namespace

JointUncertainty FindCorrelations(const SurfaceFit& fit, const hal::BendProgram& measured,
                                  const hal::BendProgram& sigma) {
  const std::size_t bends = fit.tube.program.bend_count();
  const TubeParameters fixed_radius(fit.tube, false, fit.flattening, fit.easing);
  const TubeParameters parameters(fit.tube, fit.covariance.rows() > fixed_radius.size(),
                                  fit.flattening, fit.easing);
  if (bends == 0 || parameters.size() != fit.covariance.rows() ||
      measured.rows.size() != bends + 1 || sigma.rows.size() != bends + 1) {
    return {};
  }
  const RowCovariance covariance(fit, parameters, sigma);
  JointUncertainty joint;
  joint.correlations = StrongOnes(covariance);
  std::vector<KnownTogether> runs = VagueBends(covariance, joint.correlations);
  KeepStrongest(joint.correlations);
  if (runs.empty()) return joint;
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const auto derivatives = parameters.FrameDerivatives(segments);
  for (KnownTogether& run : runs) {
    const WorstSigmas worst = WorstOf(run, covariance);
    const Eigen::MatrixXd by_parameter = TurnBehind(run, parameters, segments, derivatives);
    SetTurn(Mapped(by_parameter, fit.covariance), segments, bends, worst, run);
    SetLength(covariance, measured, worst, run);
    if (!SaysNothing(run)) joint.known_together.push_back(std::move(run));
  }
  return joint;
}

JointUncertainty Reversed(JointUncertainty joint, std::size_t bends) {
  const auto reverse = [bends](RowValue& value) {
    const bool before =
        value.kind == RowValueKind::kLength || value.kind == RowValueKind::kRotation;
    value.row = (before ? bends : bends - 1) - value.row;
  };
  const auto less = [](const RowValue& a, const RowValue& b) {
    return RowCovariance::At(a) < RowCovariance::At(b);
  };
  for (Correlation& c : joint.correlations) {
    reverse(c.first);
    reverse(c.second);
    if (less(c.second, c.first)) std::swap(c.first, c.second);
  }
  std::sort(joint.correlations.begin(), joint.correlations.end(),
            [&less](const Correlation& a, const Correlation& b) {
              return a.first == b.first ? less(a.second, b.second) : less(a.first, b.first);
            });
  for (KnownTogether& run : joint.known_together) {
    for (RowValue& value : run.values) reverse(value);
    std::sort(run.values.begin(), run.values.end(), less);
    run.first_bend = bends - 1 - run.first_bend;
    run.last_bend = bends - 1 - run.last_bend;
    std::swap(run.first_bend, run.last_bend);
  }
  std::reverse(joint.known_together.begin(), joint.known_together.end());
  return joint;
}

}  // namespace bendloop::pipeline
