// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/lot_belief.h"
#include "pipeline/correction/lot_state.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

// A measured part, as what it says of the lot.
struct SeenPart {
  Eigen::VectorXd off;         // measured - what the material model says of its command
  Eigen::MatrixXd matrix;      // ObservationMatrix of its command
  Eigen::MatrixXd covariance;  // of the measurement
  std::vector<bool> is_known;  // false: the value has no meaning and teaches nothing
  unsigned parts = 1;          // bent since the part that was learnt from before, this one included
};

// The lot with this part learnt: every hypothesis meets it, becomes as many as there are
// explanations, and the unlikely ones are dropped.
LotState LearnPart(const LotState& lot, const SeenPart& part, const CorrectionOptions& options);

// A hypothesis that may be acted on, so many parts later, with its weight (they add up to 1).
struct ActingBelief {
  double weight = 0;
  LotBelief belief;
  const LotHypothesis* hypothesis = nullptr;
};

// What a command goes by, `ahead` parts after the latest that was learnt from: a jump that only
// one part speaks for is not acted on, because a slip looks the same.
std::vector<ActingBelief> ActingBeliefs(const LotState& lot, unsigned ahead);
// All of them as one.
LotBelief Mixture(const std::vector<ActingBelief>& acting);

}  // namespace bendloop::pipeline
