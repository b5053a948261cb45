// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/forecast.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "pipeline/correction/tube_values.h"
#include "pipeline/math/probability.h"

namespace bendloop::pipeline {
namespace {

std::optional<double> ToleranceOf(const RowTolerances& tolerance, RowValueKind kind) {
  if (kind == RowValueKind::kAngle) return tolerance.angle_deg;
  return kind == RowValueKind::kRotation ? tolerance.rotation_deg : tolerance.length_mm;
}

bool IsJudged(const hal::BendProgram& nominal, const RowValue& value, double least_angle_deg) {
  const std::size_t row = value.row;
  if (value.kind != RowValueKind::kRotation) return true;
  return std::min(nominal.rows[row - 1].angle_deg, nominal.rows[row].angle_deg) >= least_angle_deg;
}

double& At(std::vector<RowForecast>& rows, const RowValue& value) {
  RowForecast& row = rows[value.row];
  if (value.kind == RowValueKind::kAngle) return row.angle_deg;
  return value.kind == RowValueKind::kRotation ? row.rotation_deg : row.length_mm;
}

// Odds of an event in one tube, from how often it came and what was thought before.
double Odds(std::uint32_t seen, std::uint32_t parts, double before,
            const LotFilterOptions& options) {
  return (options.odds_weight * options.odds_share * before + seen) / (options.odds_weight + parts);
}

}  // namespace

Forecast MakeForecast(const hal::BendProgram& nominal, const hal::BendProgram& program,
                      const std::vector<ActingBelief>& acting, const LotState& lot, unsigned ahead,
                      const CorrectionOptions& options) {
  Forecast forecast;
  const TubeValues values(nominal.bend_count());
  forecast.rows.resize(nominal.rows.size());
  for (std::size_t j = 0; j < values.size(); ++j) At(forecast.rows, values[j]) = 0;
  const std::vector<double> angles_deg = Angles(nominal);
  const Eigen::MatrixXd matrix = ObservationMatrix(program, angles_deg);
  const Eigen::VectorXd model = ModelValues(program, angles_deg, options.material);
  for (const ActingBelief& one : acting) {
    const Eigen::VectorXd mean = model + matrix * one.belief.mean;
    const Eigen::VectorXd variance =
        (matrix * one.belief.covariance).cwiseProduct(matrix).rowwise().sum();
    double all = 1;
    for (std::size_t j = 0; j < values.size(); ++j) {
      const auto [row, kind] = values[j];
      const auto tolerance = ToleranceOf(options.tolerance, kind);
      double in = 1;
      if (tolerance && IsJudged(nominal, values[j], options.least_angle_deg)) {
        double off = mean[Eigen::Index(j)] - ValueOf(nominal.rows[row], kind);
        if (kind == RowValueKind::kRotation) off = hal::WrapRotationDeg(off);
        const double scatter = OfKind(one.hypothesis->scatter, kind);
        const double sigma =
            std::sqrt(std::max(0.0, variance[Eigen::Index(j)]) + scatter * scatter);
        in = ProbabilityWithin(off, sigma, *tolerance);
      }
      At(forecast.rows, values[j]) += one.weight * in;
      all *= in;
    }
    forecast.part += one.weight * all;
  }
  const LotFilterOptions& filter = options.filter;
  const double slip =
      Odds(lot.slips, lot.parts_of_all_lots, filter.slip_odds + filter.tube_slip_odds, filter);
  const double jump =
      Odds(lot.jumps, lot.parts_of_all_lots, filter.coil_jump_odds + filter.row_jump_odds, filter);
  forecast.part *= (1 - slip) * std::pow(1 - jump, ahead);
  return forecast;
}

}  // namespace bendloop::pipeline
