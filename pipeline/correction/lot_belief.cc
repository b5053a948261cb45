// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/lot_belief.h"

#include "pipeline/correction/tube_values.h"

namespace bendloop::pipeline {
namespace {

std::size_t ValuesIn(const LotBelief& belief) {
  return static_cast<std::size_t>(belief.mean.size() - LotLayout::kCoil) / 2;
}

TubeValues LayoutOf(const LotBelief& belief) { return TubeValues((ValuesIn(belief) + 1) / 3); }

// The drift at `drift` goes into the level at `level`.
void Move(Eigen::Index level, Eigen::Index drift, LotBelief& belief) {
  belief.mean[level] += belief.mean[drift];
  belief.covariance.row(level) += belief.covariance.row(drift);
  belief.covariance.col(level) += belief.covariance.col(drift);
}

void Forget(Eigen::Index at, LotBelief& belief) {
  belief.mean[at] = 0;
  belief.covariance.row(at).setZero();
  belief.covariance.col(at).setZero();
}

double Square(double x) { return x * x; }

}  // namespace

LotBelief BeliefOf(const LotHypothesis& hypothesis) {
  const auto size = static_cast<Eigen::Index>(hypothesis.mean.size());
  LotBelief belief;
  belief.mean = Eigen::Map<const Eigen::VectorXd>(hypothesis.mean.data(), size);
  belief.covariance.resize(size, size);
  std::size_t next = 0;
  for (Eigen::Index i = 0; i < size; ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      belief.covariance(i, j) = belief.covariance(j, i) = hypothesis.covariance[next++];
    }
  }
  return belief;
}

void Keep(const LotBelief& belief, LotHypothesis& hypothesis) {
  hypothesis.mean.assign(belief.mean.data(), belief.mean.data() + belief.mean.size());
  hypothesis.covariance.clear();
  for (Eigen::Index i = 0; i < belief.mean.size(); ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) hypothesis.covariance.push_back(belief.covariance(i, j));
  }
}

const TemperamentRule& RuleOf(Temperament temperament) {
  // The priors say what is usual; the rest is the best of a search on the benders of tests/bench,
  // around the steady-state gains that they lead to: 0.02, 0.15, 0.15, 0.4 and 0.05.
  static constexpr TemperamentRule kRules[kTemperaments] = {
      {-0.5, 1, 0.02, 0.01, 0, 0, 0},          {-2.0, 1, 0.15, 0.10, 0, 0, 0},
      {-2.0, 1, 0.02, 0.01, 0.3, 0.08, 0.003}, {-4.0, 1, 0.50, 0.35, 0, 0, 0},
      {-4.0, 4, 0.05, 0.05, 0, 0, 0},
  };
  return kRules[static_cast<std::size_t>(temperament)];
}

void OpenDrift(const LotHypothesis& hypothesis, LotBelief& belief) {
  const TemperamentRule& rule = RuleOf(hypothesis.temperament);
  const TubeValues values = LayoutOf(belief);
  belief.covariance(LotLayout::kDrift, LotLayout::kDrift) +=
      Square(rule.coil_drift * hypothesis.scatter.angle_deg);
  for (std::size_t j = 0; j < values.size(); ++j) {
    belief.covariance(LotLayout::Drift(j), LotLayout::Drift(j)) +=
        Square(rule.row_drift * OfKind(hypothesis.scatter, values[j].kind));
  }
}

void Predict(const LotHypothesis& hypothesis, unsigned parts, LotBelief& belief) {
  const TemperamentRule& rule = RuleOf(hypothesis.temperament);
  const TubeValues values = LayoutOf(belief);
  Eigen::MatrixXd& covariance = belief.covariance;
  const double angle_deg = hypothesis.scatter.angle_deg;
  for (unsigned part = 0; part < parts; ++part) {
    if (rule.drifts()) {
      Move(LotLayout::kConstant, LotLayout::kDrift, belief);
    } else {
      Forget(LotLayout::kDrift, belief);
    }
    covariance(LotLayout::kConstant, LotLayout::kConstant) += Square(rule.coil_wander * angle_deg);
    covariance(LotLayout::kDrift, LotLayout::kDrift) += Square(rule.drift_wander * angle_deg);
    for (std::size_t j = 0; j < values.size(); ++j) {
      const Eigen::Index level = LotLayout::Level(j);
      const Eigen::Index drift = LotLayout::Drift(j);
      const RowValueKind kind = values[j].kind;
      if (rule.drifts()) {
        Move(level, drift, belief);
      } else {
        Forget(drift, belief);
      }
      const double scatter = OfKind(hypothesis.scatter, kind);
      // Angles wander and drift with the coil; the others by themselves alone.
      const bool alone = kind != RowValueKind::kAngle;
      covariance(level, level) += Square((alone ? rule.coil_wander : rule.row_wander) * scatter);
      covariance(drift, drift) += Square(rule.drift_wander * scatter);
    }
  }
}

void OpenCoil(const LotFilterOptions& options, LotBelief& belief) {
  Eigen::MatrixXd& covariance = belief.covariance;
  covariance(LotLayout::kConstant, LotLayout::kConstant) += Square(options.next_coil_constant_deg);
  covariance(LotLayout::kSlope, LotLayout::kSlope) += Square(options.next_coil_slope_deg);
  covariance(LotLayout::kStretch, LotLayout::kStretch) += Square(options.next_coil_stretch_percent);
}

void OpenLevels(const std::vector<std::uint32_t>& values, const Eigen::VectorXd& variance,
                LotBelief& belief) {
  for (const std::uint32_t j : values) {
    belief.covariance(LotLayout::Level(j), LotLayout::Level(j)) += variance[Eigen::Index(j)];
  }
}

}  // namespace bendloop::pipeline
