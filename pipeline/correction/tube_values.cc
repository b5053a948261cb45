// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/tube_values.h"

#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {

RowValue TubeValues::operator[](std::size_t value) const {
  if (value < bends_) return {value, RowValueKind::kAngle};
  if (value < bends_ + rotations()) return {value - bends_ + 1, RowValueKind::kRotation};
  return {value - bends_ - rotations(), RowValueKind::kLength};
}

double ValueOf(const hal::BendRow& row, RowValueKind kind) {
  if (kind == RowValueKind::kAngle) return row.angle_deg;
  return kind == RowValueKind::kRotation ? row.rotation_deg : row.length_mm;
}

double OfKind(const PerAxis& axes, RowValueKind kind) {
  if (kind == RowValueKind::kAngle) return axes.angle_deg;
  return kind == RowValueKind::kRotation ? axes.rotation_deg : axes.length_mm;
}

double& OfKind(PerAxis& axes, RowValueKind kind) {
  if (kind == RowValueKind::kAngle) return axes.angle_deg;
  return kind == RowValueKind::kRotation ? axes.rotation_deg : axes.length_mm;
}

const char* UnitOf(RowValueKind kind) { return kind == RowValueKind::kLength ? "mm" : "degrees"; }

std::string NameOf(const RowValue& value, std::size_t bends) {
  if (value.kind == RowValueKind::kAngle) return AngleName(value.row);
  if (value.kind == RowValueKind::kRotation) return RotationName(value.row);
  return LengthName(value.row, bends);
}

double StretchMm(const hal::BendProgram& radii_of, const std::vector<double>& angles_deg,
                 std::size_t row, const Material& material) {
  double stretch_mm = 0;
  const auto add = [&](std::size_t bend) {
    stretch_mm += material.StretchOfStraightMm(radii_of.rows[bend].bend_radius_mm.value_or(0.0),
                                               angles_deg[bend]);
  };
  if (row > 0) add(row - 1);
  if (row < radii_of.bend_count()) add(row);
  return stretch_mm;
}

std::vector<double> Angles(const hal::BendProgram& program) {
  std::vector<double> angles_deg;
  for (const hal::BendRow& row : program.rows) angles_deg.push_back(row.angle_deg);
  return angles_deg;
}

Eigen::VectorXd ModelValues(const hal::BendProgram& commanded,
                            const std::vector<double>& angles_deg, const Material& material) {
  const TubeValues values(commanded.bend_count());
  Eigen::VectorXd model(values.size());
  for (std::size_t j = 0; j < values.size(); ++j) {
    const auto [row, kind] = values[j];
    const double command = ValueOf(commanded.rows[row], kind);
    model[Eigen::Index(j)] = command;
    if (kind == RowValueKind::kAngle) {
      model[Eigen::Index(j)] = command == 0 ? 0 : material.AngleAfterDeg(command);
    } else if (kind == RowValueKind::kLength) {
      model[Eigen::Index(j)] += StretchMm(commanded, angles_deg, row, material);
    }
  }
  return model;
}

Eigen::MatrixXd ObservationMatrix(const hal::BendProgram& commanded,
                                  const std::vector<double>& angles_deg) {
  // Springback is entered at 20 and 120 degrees: their middle, and half of their distance.
  constexpr double kMiddleDeg = 70;
  constexpr double kSpanDeg = 50;
  const TubeValues values(commanded.bend_count());
  Eigen::MatrixXd matrix =
      Eigen::MatrixXd::Zero(Eigen::Index(values.size()), LotLayout::Size(values.size()));
  for (std::size_t j = 0; j < values.size(); ++j) {
    const auto at = Eigen::Index(j);
    const auto [row, kind] = values[j];
    matrix(at, LotLayout::Level(j)) = 1;
    if (kind == RowValueKind::kAngle) {
      matrix(at, LotLayout::kConstant) = 1;
      matrix(at, LotLayout::kSlope) = (commanded.rows[row].angle_deg - kMiddleDeg) / kSpanDeg;
    } else if (kind == RowValueKind::kLength) {
      matrix(at, LotLayout::kStretch) =
          StretchMm(commanded, angles_deg, row, {0, 0, /*elongation_percent=*/1});
    }
  }
  return matrix;
}

}  // namespace bendloop::pipeline
