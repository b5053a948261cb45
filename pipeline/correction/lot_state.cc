// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/lot_state.h"

#include <algorithm>

#include "pipeline/correction/lot_belief.h"
#include "pipeline/correction/tube_values.h"

namespace bendloop::pipeline {
namespace {

double Variance(double sigma) { return sigma * sigma; }

LotHypothesis Fresh(Temperament temperament, const CorrectionOptions& options) {
  LotHypothesis fresh;
  const TemperamentRule& rule = RuleOf(temperament);
  fresh.temperament = temperament;
  fresh.log_weight = rule.log_prior;
  fresh.parts_since = options.filter.open_parts;
  for (const auto kind : {RowValueKind::kLength, RowValueKind::kRotation, RowValueKind::kAngle}) {
    OfKind(fresh.scatter, kind) = rule.scatter_factor * OfKind(options.scatter_sigma, kind);
    OfKind(fresh.scatter_weight, kind) = options.filter.scatter_weight;
  }
  return fresh;
}

}  // namespace

std::string_view Name(Temperament temperament) {
  switch (temperament) {
    case Temperament::kSteady:
      return "steady";
    case Temperament::kWandering:
      return "wandering";
    case Temperament::kDrifting:
      return "drifting";
    case Temperament::kRestless:
      return "restless";
    case Temperament::kRough:
      break;
  }
  return "rough";
}

std::string_view Name(LotEvent event) {
  switch (event) {
    case LotEvent::kNone:
      return "none";
    case LotEvent::kSlip:
      return "slip";
    case LotEvent::kRowJump:
      return "jump of a row";
    case LotEvent::kCoilJump:
      break;
  }
  return "jump of the coil";
}

LotState StartLot(const hal::BendProgram& nominal, const hal::BendProgram& base,
                  const CorrectionOptions& options) {
  LotState lot;
  lot.base = base;
  if (nominal.rows.empty() || base.rows.size() != nominal.rows.size()) return lot;
  const TubeValues values(nominal.bend_count());
  LotBelief belief;
  const Eigen::Index size = LotLayout::Size(values.size());
  belief.mean = Eigen::VectorXd::Zero(size);
  belief.covariance = Eigen::MatrixXd::Zero(size, size);
  const Eigen::VectorXd model = ModelValues(base, Angles(nominal), options.material);
  const LotFilterOptions& filter = options.filter;
  const double coil[] = {filter.first_coil_constant_deg, filter.first_coil_slope_deg,
                         filter.first_coil_stretch_percent};
  for (Eigen::Index i = 0; i < 3; ++i) belief.covariance(i, i) = Variance(coil[i]);
  for (std::size_t j = 0; j < values.size(); ++j) {
    const auto [row, kind] = values[j];
    const double off = ValueOf(nominal.rows[row], kind) - model[Eigen::Index(j)];
    const Eigen::Index level = LotLayout::Level(j);
    belief.mean[level] = kind == RowValueKind::kRotation ? hal::WrapRotationDeg(off) : off;
    belief.covariance(level, level) = Variance(OfKind(filter.first_row, kind));
  }
  for (std::size_t t = 0; t < kTemperaments; ++t) {
    LotHypothesis hypothesis = Fresh(static_cast<Temperament>(t), options);
    LotBelief own = belief;
    OpenDrift(hypothesis, own);
    Keep(own, hypothesis);
    lot.hypotheses.push_back(std::move(hypothesis));
  }
  return lot;
}

LotState NextLot(const LotState& ended, const hal::BendProgram& base,
                 const CorrectionOptions& options) {
  LotState lot = ended;
  lot.number = ended.number + 1;
  lot.parts = 0;
  lot.held = false;
  lot.base = base;
  if (ended.hypotheses.empty()) return lot;
  const LotHypothesis& best = ended.hypotheses.front();
  LotBelief belief = BeliefOf(best);
  OpenCoil(options.filter, belief);
  const TubeValues values(base.bend_count());
  for (std::size_t j = 0; j < values.size(); ++j) {
    const Eigen::Index level = LotLayout::Level(j);
    belief.covariance(level, level) += Variance(OfKind(options.filter.next_row, values[j].kind));
  }
  lot.hypotheses.clear();
  for (std::size_t t = 0; t < kTemperaments; ++t) {
    LotHypothesis hypothesis = Fresh(static_cast<Temperament>(t), options);
    const double factor = RuleOf(hypothesis.temperament).scatter_factor;
    for (const auto kind : {RowValueKind::kLength, RowValueKind::kRotation, RowValueKind::kAngle}) {
      OfKind(hypothesis.scatter, kind) = factor * OfKind(best.scatter, kind);
      OfKind(hypothesis.scatter_weight, kind) =
          std::min(OfKind(best.scatter_weight, kind), options.filter.most_scatter_weight / 2);
    }
    LotBelief own = belief;
    if (!RuleOf(best.temperament).drifts()) OpenDrift(hypothesis, own);
    Keep(own, hypothesis);
    lot.hypotheses.push_back(std::move(hypothesis));
  }
  return lot;
}

}  // namespace bendloop::pipeline
