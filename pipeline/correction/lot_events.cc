// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/lot_events.h"

#include <cmath>

#include "pipeline/math/definite_solver.h"

namespace bendloop::pipeline {
namespace {

double LogLikelihood(const Eigen::VectorXd& innovation, const DefiniteSolver& covariance) {
  return -0.5 * (covariance.Square(innovation) + covariance.LogDeterminant());
}

struct Outliers {
  std::vector<std::uint32_t> values;
  double log_gain = 0;  // of the likelihood
};

// The values that, taken out of the expectation, make the others fit: one after another, each the
// one that gains most, as long as it gains more than it costs.
Outliers FindOutliers(const Eigen::VectorXd& innovation, Eigen::MatrixXd inverse,
                      const Eigen::VectorXd& event_variance, const LotFilterOptions& options) {
  Outliers found;
  const double least = -std::log(options.further_value_odds);
  Eigen::VectorXd left = event_variance;
  while (true) {
    const Eigen::VectorXd pull = inverse * innovation;
    Eigen::Index best = -1;
    double best_gain = found.values.empty() ? -std::log(options.slip_odds) : least;
    for (Eigen::Index j = 0; j < innovation.size(); ++j) {
      if (left[j] <= 0) continue;
      const double denominator = 1 + left[j] * inverse(j, j);
      const double gain = 0.5 * (left[j] * pull[j] * pull[j] / denominator - std::log(denominator));
      if (gain <= best_gain) continue;
      best = j;
      best_gain = gain;
    }
    if (best < 0) return found;
    found.values.push_back(static_cast<std::uint32_t>(best));
    found.log_gain += best_gain;
    const Eigen::VectorXd column = inverse.col(best);
    inverse -= column * column.transpose() * (left[best] / (1 + left[best] * column[best]));
    left[best] = 0;
  }
}

}  // namespace

std::vector<LotExplanation> Explanations(const LotSurprise& surprise,
                                         const LotFilterOptions& options) {
  std::vector<LotExplanation> found;
  const DefiniteSolver covariance(surprise.covariance);
  const Eigen::Index size = surprise.innovation.size();
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(size, size);
  const double plain = LogLikelihood(surprise.innovation, covariance);
  found.push_back({LotEvent::kNone, {}, plain, false});
  if (surprise.is_first) return found;
  const double log_size = std::log(static_cast<double>(size));
  const double log_further = std::log(options.further_value_odds);
  const Outliers alone = FindOutliers(surprise.innovation, covariance.Solve(identity),
                                      surprise.event_variance, options);
  if (!alone.values.empty()) {
    const double likelihood = plain + alone.log_gain - log_size +
                              log_further * static_cast<double>(alone.values.size() - 1);
    found.push_back(
        {LotEvent::kSlip, alone.values, likelihood + std::log(options.slip_odds), false});
    found.push_back(
        {LotEvent::kRowJump, alone.values, likelihood + std::log(options.row_jump_odds), false});
  }
  const DefiniteSolver coil_covariance(surprise.coil_covariance);
  const double coil = LogLikelihood(surprise.innovation, coil_covariance);
  // Not worth a look: less likely than the expected by this much.
  constexpr double kHopeless = 3;
  if (coil + std::log(options.coil_jump_odds) <= plain - kHopeless) return found;
  const Outliers beside = FindOutliers(surprise.innovation, coil_covariance.Solve(identity),
                                       surprise.event_variance, options);
  double likelihood = coil;
  if (!beside.values.empty()) {
    likelihood += beside.log_gain + std::log(options.slip_odds) - log_size +
                  log_further * static_cast<double>(beside.values.size() - 1);
  }
  found.push_back({LotEvent::kSlip, beside.values, likelihood + std::log(options.tube_slip_odds),
                   /*is_of_coil=*/true});
  found.push_back({LotEvent::kCoilJump, beside.values,
                   likelihood + std::log(options.coil_jump_odds), /*is_of_coil=*/true});
  return found;
}

}  // namespace bendloop::pipeline
