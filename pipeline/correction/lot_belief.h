// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/lot_state.h"

namespace bendloop::pipeline {

// A hypothesis' mean and covariance as matrices (LotLayout).
struct LotBelief {
  Eigen::VectorXd mean;
  Eigen::MatrixXd covariance;
};

LotBelief BeliefOf(const LotHypothesis& hypothesis);
void Keep(const LotBelief& belief, LotHypothesis& hypothesis);

// What a temperament does from part to part, in scatters of the bender (angles' for the coil).
struct TemperamentRule {
  double log_prior;
  double scatter_factor;  // of the first guess at the scatter
  double coil_wander, row_wander;
  double coil_drift, row_drift;  // 1 sigma of a drift that begins
  double drift_wander;

  bool drifts() const { return coil_drift > 0; }
};
const TemperamentRule& RuleOf(Temperament temperament);

// Drift that a hypothesis has not known so far may begin.
void OpenDrift(const LotHypothesis& hypothesis, LotBelief& belief);

// So many parts later.
void Predict(const LotHypothesis& hypothesis, unsigned parts, LotBelief& belief);

// What happens to the belief when the coil, or these values, jump.
void OpenCoil(const LotFilterOptions& options, LotBelief& belief);
void OpenLevels(const std::vector<std::uint32_t>& values, const Eigen::VectorXd& variance,
                LotBelief& belief);

}  // namespace bendloop::pipeline
