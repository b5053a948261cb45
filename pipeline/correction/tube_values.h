// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/material.h"
#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::pipeline {

// The numbers of a tube that a bender can be told, in one row: the angles of n bends, then the
// rotations of bends 2 to n, then n + 1 lengths [mm, degrees].
class TubeValues {
 public:
  explicit TubeValues(std::size_t bends) : bends_(bends) {}

  std::size_t bends() const { return bends_; }
  std::size_t size() const { return 2 * bends_ + 1 + rotations(); }
  RowValue operator[](std::size_t value) const;
  std::size_t Angle(std::size_t row) const { return row; }
  std::size_t Rotation(std::size_t row) const { return bends_ + row - 1; }  // not of row 0
  std::size_t Length(std::size_t row) const { return bends_ + rotations() + row; }

 private:
  std::size_t rotations() const { return bends_ > 0 ? bends_ - 1 : 0; }
  std::size_t bends_;
};

double ValueOf(const hal::BendRow& row, RowValueKind kind);
double OfKind(const PerAxis& axes, RowValueKind kind);
double& OfKind(PerAxis& axes, RowValueKind kind);
const char* UnitOf(RowValueKind kind);
// "bend 3 angle".
std::string NameOf(const RowValue& value, std::size_t bends);

// Stretch of straight `row` by the bends beside it [mm], once they have these angles.
double StretchMm(const hal::BendProgram& radii_of, const std::vector<double>& angles_deg,
                 std::size_t row, const Material& material);
std::vector<double> Angles(const hal::BendProgram& program);

// What the material model says that a value becomes; the lengths by the tube's own angles.
Eigen::VectorXd ModelValues(const hal::BendProgram& commanded,
                            const std::vector<double>& angles_deg, const Material& material);

// What is believed of a lot, as one column of numbers: what the coil does, then of each value how
// far it is off besides, and by how much that moves from part to part.
struct LotLayout {
  static constexpr Eigen::Index kConstant = 0;  // [deg] of each angle
  static constexpr Eigen::Index kSlope = 1;     // [deg per 50 degrees commanded above 70]
  static constexpr Eigen::Index kStretch = 2;   // [%] of the arcs
  static constexpr Eigen::Index kDrift = 3;     // [deg per part] of kConstant
  static constexpr Eigen::Index kCoil = 4;      // so many belong to the coil
  static Eigen::Index Level(std::size_t value) { return kCoil + 2 * Eigen::Index(value); }
  static Eigen::Index Drift(std::size_t value) { return Level(value) + 1; }
  static Eigen::Index Size(std::size_t values) { return kCoil + 2 * Eigen::Index(values); }
};

// value - ModelValues = matrix x belief.
Eigen::MatrixXd ObservationMatrix(const hal::BendProgram& commanded,
                                  const std::vector<double>& angles_deg);

}  // namespace bendloop::pipeline
