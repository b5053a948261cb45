// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/measured_covariance.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "pipeline/correction/tube_values.h"
#include "pipeline/math/definite_solver.h"

namespace bendloop::pipeline {
namespace {

// [mm, degrees] What is known to no better than this is not known; a sigma that is no number, too.
constexpr double kNotKnown = 1e3;

std::optional<Eigen::Index> PlaceOf(const RowValue& value, const TubeValues& values) {
  for (std::size_t j = 0; j < values.size(); ++j) {
    if (values[j] == value) return Eigen::Index(j);
  }
  return std::nullopt;
}

RowValue FromOtherEnd(const RowValue& value, std::size_t bends) {
  // A rotation stands between two bends, counted as that of the later one.
  if (value.kind == RowValueKind::kRotation) return {bends - value.row, value.kind};
  if (value.kind == RowValueKind::kLength) return {bends - value.row, value.kind};
  return {bends - 1 - value.row, value.kind};
}

}  // namespace

Eigen::MatrixXd MeasuredCovariance(const hal::BendProgram& sigma,
                                   const std::vector<Correlation>& correlations) {
  const TubeValues values(sigma.bend_count());
  const auto size = Eigen::Index(values.size());
  Eigen::VectorXd sigmas(size);
  for (std::size_t j = 0; j < values.size(); ++j) {
    const double value = std::abs(ValueOf(sigma.rows[values[j].row], values[j].kind));
    sigmas[Eigen::Index(j)] = value < kNotKnown ? value : kNotKnown;
  }
  Eigen::MatrixXd apart = Eigen::MatrixXd::Zero(size, size);
  for (const Correlation& correlation : correlations) {
    const auto first = PlaceOf(correlation.first, values);
    const auto second = PlaceOf(correlation.second, values);
    if (!first || !second || *first == *second || !std::isfinite(correlation.coefficient)) continue;
    apart(*first, *second) = apart(*second, *first) =
        std::clamp(correlation.coefficient, -0.9999, 0.9999);
  }
  Eigen::MatrixXd coefficients = Eigen::MatrixXd::Identity(size, size) + apart;
  constexpr double kSmaller = 0.97;
  for (int tries = 0; tries < 200; ++tries) {
    if (DefiniteSolver(coefficients).is_definite()) break;
    apart *= kSmaller;
    coefficients = Eigen::MatrixXd::Identity(size, size) + apart;
  }
  return sigmas.asDiagonal() * coefficients * sigmas.asDiagonal();
}

std::vector<Correlation> ReversedCorrelations(std::vector<Correlation> correlations,
                                              std::size_t bends) {
  const auto is_bend = [](const RowValue& value) {
    return value.kind == RowValueKind::kAngle || value.kind == RowValueKind::kBendRadius;
  };
  std::vector<Correlation> reversed;
  for (Correlation& correlation : correlations) {
    bool fits = true;
    for (const RowValue& value : {correlation.first, correlation.second}) {
      fits = fits && value.row <= bends && !(is_bend(value) && value.row == bends) &&
             !(value.kind == RowValueKind::kRotation && (value.row == 0 || value.row == bends));
    }
    if (!fits) continue;
    correlation.first = FromOtherEnd(correlation.first, bends);
    correlation.second = FromOtherEnd(correlation.second, bends);
    reversed.push_back(correlation);
  }
  return reversed;
}

}  // namespace bendloop::pipeline
