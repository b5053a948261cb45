// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/lot_filter.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "pipeline/correction/lot_events.h"
#include "pipeline/correction/tube_values.h"
#include "pipeline/math/definite_solver.h"
#include "pipeline/math/dense_product.h"

namespace bendloop::pipeline {
namespace {

// [mm^2, degrees^2] of a value that teaches nothing.
constexpr double kNothingKnown = 1e8;
// A single value's part in learning the scatter: beyond three sigma it is no more than that.
constexpr double kMostSquare = 9;

Eigen::VectorXd ScatterVariance(const LotHypothesis& hypothesis, const TubeValues& values) {
  Eigen::VectorXd variance(values.size());
  for (std::size_t j = 0; j < values.size(); ++j) {
    variance[Eigen::Index(j)] = std::pow(OfKind(hypothesis.scatter, values[j].kind), 2);
  }
  return variance;
}

// One hypothesis on its way through one part.
class Meeting {
 public:
  Meeting(const LotHypothesis& before, bool is_first, const SeenPart& part,
          const CorrectionOptions& options)
      : before_(before),
        part_(part),
        options_(options),
        values_((static_cast<std::size_t>(part.off.size()) + 1) / 3),
        belief_(BeliefOf(before)) {
    Predict(before, part.parts, belief_);
    noise_ = part.covariance;
    // [mm^2, degrees^2] Even a bender without scatter is a thousandth of a micron off.
    constexpr double kLeastVariance = 1e-12;
    noise_.diagonal() += ScatterVariance(before, values_);
    noise_.diagonal().array() += kLeastVariance;
    surprise_.is_first = is_first;
    surprise_.innovation = part.off - part.matrix * belief_.mean;
    surprise_.event_variance.resize(part.off.size());
    for (std::size_t j = 0; j < values_.size(); ++j) {
      const auto at = Eigen::Index(j);
      const RowValueKind kind = values_[j].kind;
      double& innovation = surprise_.innovation[at];
      if (kind == RowValueKind::kRotation) innovation = hal::WrapRotationDeg(innovation);
      surprise_.event_variance[at] =
          part.is_known[j] ? std::pow(OfKind(options.filter.slip, kind), 2) : 0;
      if (part.is_known[j]) continue;
      innovation = 0;
      noise_.row(at).setZero();
      noise_.col(at).setZero();
      noise_(at, at) = kNothingKnown;
    }
    surprise_.covariance = Expected(belief_);
    LotBelief coil = belief_;
    OpenCoil(options.filter, coil);
    surprise_.coil_covariance = Expected(coil);
  }

  std::vector<LotHypothesis> Outcomes() const {
    std::vector<LotHypothesis> outcomes;
    for (const LotExplanation& why : Explanations(surprise_, options_.filter)) {
      outcomes.push_back(Outcome(why));
    }
    return outcomes;
  }

 private:
  Eigen::MatrixXd Expected(const LotBelief& belief) const {
    return Mapped(part_.matrix, belief.covariance) + noise_;
  }

  LotHypothesis Outcome(const LotExplanation& why) const {
    LotHypothesis after = before_;
    after.log_weight += why.log_likelihood;
    ++after.parts_since;
    if (why.event != LotEvent::kNone) {
      after.event = why.event;
      after.parts_since = 0;
      after.values = why.values;
    }
    LotBelief belief = belief_;
    if (why.event == LotEvent::kCoilJump) OpenCoil(options_.filter, belief);
    if (why.event == LotEvent::kRowJump) {
      OpenLevels(why.values, surprise_.event_variance, belief);
    }
    Eigen::MatrixXd covariance = Expected(belief);
    if (why.event == LotEvent::kSlip && why.is_of_coil) covariance = surprise_.coil_covariance;
    if (why.event != LotEvent::kRowJump) {  // slipped
      for (const std::uint32_t j : why.values) covariance(j, j) += surprise_.event_variance[j];
    }
    const DefiniteSolver solver(covariance);
    const Eigen::MatrixXd cross = Product(part_.matrix, belief.covariance);
    belief.mean += TransposeProduct(cross, solver.Solve(surprise_.innovation));
    belief.covariance -= TransposeProduct(cross, solver.Solve(cross));
    Keep(belief, after);
    LearnScatter(why, covariance, after);
    return after;
  }

  // From what was not expected, as far as it is scatter and not what was not known.
  void LearnScatter(const LotExplanation& why, const Eigen::MatrixXd& covariance,
                    LotHypothesis& after) const {
    for (std::size_t j = 0; j < values_.size(); ++j) {
      const auto at = Eigen::Index(j);
      if (!part_.is_known[j] ||
          std::find(why.values.begin(), why.values.end(), j) != why.values.end()) {
        continue;
      }
      const RowValueKind kind = values_[j].kind;
      double& scatter = OfKind(after.scatter, kind);
      double& weight = OfKind(after.scatter_weight, kind);
      const double expected = covariance(at, at);
      const double share = std::min(1.0, scatter * scatter / expected);
      const double square =
          std::min(kMostSquare, surprise_.innovation[at] * surprise_.innovation[at] / expected);
      scatter *= std::sqrt((weight + share * square) / (weight + share));
      weight = std::min(weight + share, options_.filter.most_scatter_weight);
    }
  }

  const LotHypothesis& before_;
  const SeenPart& part_;
  const CorrectionOptions& options_;
  TubeValues values_;
  LotBelief belief_;  // before the part is seen
  Eigen::MatrixXd noise_;
  LotSurprise surprise_;
};

bool IsLikelier(const LotHypothesis& a, const LotHypothesis& b) {
  return a.log_weight > b.log_weight;
}

bool IsConfirmed(const LotHypothesis& hypothesis) {
  const bool is_jump =
      hypothesis.event == LotEvent::kRowJump || hypothesis.event == LotEvent::kCoilJump;
  return !is_jump || hypothesis.parts_since > 0;
}

// The likeliest of each temperament, and those that may still turn out to be right; one at least
// that may be acted on.
std::vector<LotHypothesis> Pruned(std::vector<LotHypothesis> all, const LotFilterOptions& options) {
  std::stable_sort(all.begin(), all.end(), IsLikelier);
  // e^-12: beside the best no more than an error of rounding.
  constexpr double kFarBehind = 12;
  std::array<const LotHypothesis*, kTemperaments> best{};
  std::vector<const LotHypothesis*> kept;
  std::vector<const LotHypothesis*> others;
  const LotHypothesis* confirmed = nullptr;
  for (const LotHypothesis& hypothesis : all) {
    const LotHypothesis*& first = best[static_cast<std::size_t>(hypothesis.temperament)];
    if (confirmed == nullptr && IsConfirmed(hypothesis)) confirmed = &hypothesis;
    if (first == nullptr) {
      first = &hypothesis;
      kept.push_back(&hypothesis);
    } else if (hypothesis.parts_since < options.open_parts ||
               first->parts_since < options.open_parts) {
      others.push_back(&hypothesis);
    }
  }
  if (std::find(kept.begin(), kept.end(), confirmed) == kept.end()) kept.push_back(confirmed);
  for (const LotHypothesis* other : others) {
    if (kept.size() >= options.most_hypotheses || other == confirmed) continue;
    if (other->log_weight > all.front().log_weight - kFarBehind) kept.push_back(other);
  }
  std::vector<LotHypothesis> left;
  for (const LotHypothesis* one : kept) left.push_back(*one);
  std::stable_sort(left.begin(), left.end(), IsLikelier);
  return left;
}

// A temperament that the lot does not show keeps a little weight, and when it has lost its way it
// begins again from what the likeliest one knows.
void KeepInPlay(const LotFilterOptions& options, const CorrectionOptions& all,
                std::vector<LotHypothesis>& hypotheses) {
  constexpr double kForgets = 0.8;  // what lay behind, from part to part
  constexpr double kLost = 6.0;     // so much behind
  const LotHypothesis best = hypotheses.front();
  std::array<bool, kTemperaments> seen{};
  for (LotHypothesis& hypothesis : hypotheses) {
    const auto t = static_cast<std::size_t>(hypothesis.temperament);
    hypothesis.log_weight -= best.log_weight;
    if (seen[t]) continue;  // another story of the same
    seen[t] = true;
    const double least = -options.least_log_weight;
    hypothesis.behind = kForgets * hypothesis.behind + std::max(0.0, least - hypothesis.log_weight);
    hypothesis.log_weight = std::max(hypothesis.log_weight, least);
    if (hypothesis.behind < kLost) continue;
    const Temperament temperament = hypothesis.temperament;
    hypothesis = best;
    hypothesis.temperament = temperament;
    hypothesis.log_weight = least;
    hypothesis.behind = 0;
    const TemperamentRule& rule = RuleOf(temperament);
    if (rule.scatter_factor > RuleOf(best.temperament).scatter_factor) {
      for (const auto kind :
           {RowValueKind::kLength, RowValueKind::kRotation, RowValueKind::kAngle}) {
        OfKind(hypothesis.scatter, kind) *= rule.scatter_factor;
        OfKind(hypothesis.scatter_weight, kind) = all.filter.scatter_weight;
      }
    }
    if (rule.drifts() && !RuleOf(best.temperament).drifts()) {
      LotBelief belief = BeliefOf(hypothesis);
      OpenDrift(hypothesis, belief);
      Keep(belief, hypothesis);
    }
  }
}

}  // namespace

LotState LearnPart(const LotState& lot, const SeenPart& part, const CorrectionOptions& options) {
  LotState next = lot;
  ++next.parts;
  ++next.parts_of_all_lots;
  const bool is_first = lot.parts_of_all_lots == 0;
  std::vector<LotHypothesis> outcomes;
  for (const LotHypothesis& hypothesis : lot.hypotheses) {
    for (LotHypothesis& outcome : Meeting(hypothesis, is_first, part, options).Outcomes()) {
      outcomes.push_back(std::move(outcome));
    }
  }
  next.hypotheses = Pruned(std::move(outcomes), options.filter);
  KeepInPlay(options.filter, options, next.hypotheses);
  // Counted when the time in which the other explanation may win is over.
  const LotHypothesis& best = next.hypotheses.front();
  if (best.parts_since + 1 == options.filter.open_parts) {
    next.slips += best.event == LotEvent::kSlip;
    next.jumps += best.event == LotEvent::kRowJump || best.event == LotEvent::kCoilJump;
  }
  return next;
}

std::vector<ActingBelief> ActingBeliefs(const LotState& lot, unsigned ahead) {
  std::vector<ActingBelief> acting;
  double sum = 0;
  double most = 0;
  bool has_any = false;
  for (const LotHypothesis& hypothesis : lot.hypotheses) {
    if (!IsConfirmed(hypothesis)) continue;
    if (!has_any) most = hypothesis.log_weight;
    has_any = true;
    ActingBelief one;
    one.weight = std::exp(hypothesis.log_weight - most);
    sum += one.weight;
    one.belief = BeliefOf(hypothesis);
    Predict(hypothesis, ahead, one.belief);
    one.hypothesis = &hypothesis;
    acting.push_back(std::move(one));
  }
  for (ActingBelief& one : acting) one.weight /= sum;
  return acting;
}

LotBelief Mixture(const std::vector<ActingBelief>& acting) {
  LotBelief mixture;
  const Eigen::Index size = acting.front().belief.mean.size();
  mixture.mean = Eigen::VectorXd::Zero(size);
  mixture.covariance = Eigen::MatrixXd::Zero(size, size);
  for (const ActingBelief& one : acting) mixture.mean += one.weight * one.belief.mean;
  for (const ActingBelief& one : acting) {
    const Eigen::VectorXd apart = one.belief.mean - mixture.mean;
    mixture.covariance += one.weight * (one.belief.covariance + apart * apart.transpose());
  }
  return mixture;
}

}  // namespace bendloop::pipeline
