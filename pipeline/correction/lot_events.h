// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "pipeline/correction/lot_state.h"

namespace bendloop::pipeline {

// One way to take a part: what happened, and how likely the part is then.
struct LotExplanation {
  LotEvent event = LotEvent::kNone;
  std::vector<std::uint32_t> values;  // that slipped or jumped, as TubeValues counts
  double log_likelihood = 0;          // with the event's own odds
  bool is_of_coil = false;            // springback and stretch are other ones
};

// A part as the filter meets it.
struct LotSurprise {
  Eigen::VectorXd innovation;       // what the lot did not expect of each value
  Eigen::MatrixXd covariance;       // of it
  Eigen::MatrixXd coil_covariance;  // of it, had the coil jumped
  Eigen::VectorXd event_variance;   // of a value that slips or jumps; 0: it is not looked at
  // Nothing is known that it could differ from: however far off it is, that is the bender's.
  bool is_first = false;
};

// The part as it is expected, and what else it may be, each at most once.
std::vector<LotExplanation> Explanations(const LotSurprise& surprise,
                                         const LotFilterOptions& options);

}  // namespace bendloop::pipeline
