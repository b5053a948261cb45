// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/support/uniform.h"

// Scans of random tubes and what their reconstruction has to hold to.
namespace bendloop::tests {

using Random = std::mt19937_64;
using Points = std::vector<Eigen::Vector3d>;

#ifdef BENDLOOP_FEW_SEEDS
inline constexpr int kSeeds = 2;
#else
inline constexpr int kSeeds = 20;
#endif

inline Eigen::Vector3d RandomUnit(Random& random) {
  std::normal_distribution<double> normal;
  return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
}

inline hal::Result<pipeline::Measurement> Measure(
    const Points& points, const pipeline::ReconstructionOptions& options = {},
    pipeline::Workers* workers = nullptr) {
  const hal::ManualClock clock;
  return pipeline::Reconstruct(points, options, clock, workers);
}

// Lengths, rotations and angles of a bend program read from its other end.
inline hal::BendProgram Reversed(const hal::BendProgram& program) {
  hal::BendProgram reversed;
  const std::size_t n = program.bend_count();
  for (std::size_t i = 0; i <= n; ++i) {
    hal::BendRow row;
    row.length_mm = program.rows[n - i].length_mm;
    if (i < n) {
      row.angle_deg = program.rows[n - 1 - i].angle_deg;
      row.bend_radius_mm = program.rows[n - 1 - i].bend_radius_mm;
      if (i > 0) row.rotation_deg = program.rows[n - i].rotation_deg;
    }
    reversed.rows.push_back(row);
  }
  return reversed;
}

inline double RotationError(double a_deg, double b_deg) {
  return std::abs(std::remainder(a_deg - b_deg, 360.0));
}

// The scan does not say at which end the tube begins: true when `found` runs the other way.
inline bool RunsBackward(const hal::Tube& found, const hal::Tube& truth) {
  const auto segments = hal::SpineSegments(truth.program, truth.X_WT);
  const Eigen::Vector3d end = segments.back().PointAt(segments.back().length_mm);
  return (found.X_WT.position_mm - end).norm() <
         (found.X_WT.position_mm - truth.X_WT.position_mm).norm();
}

struct Floor {
  double length_mm = 0.05;
  double angle_deg = 0.05;
  double end_mm = 0;  // what the spacing of the samples leaves open at the ends
};

// Same number of bends, and every value within 5 reported standard deviations and a small floor.
inline void ExpectMeasured(const pipeline::Measurement& found, const hal::Tube& truth,
                           const Floor& floor) {
  const hal::BendProgram& program = found.tube.program;
  ASSERT_EQ(program.bend_count(), truth.program.bend_count());
  ASSERT_EQ(found.sigma.rows.size(), program.rows.size());
  EXPECT_NEAR(found.tube.pipe_radius_mm, truth.pipe_radius_mm,
              5 * found.pipe_radius_sigma_mm + 0.01 * truth.pipe_radius_mm);
  const hal::BendProgram expected =
      RunsBackward(found.tube, truth) ? Reversed(truth.program) : truth.program;
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    const auto& row = program.rows[i];
    const auto& sigma = found.sigma.rows[i];
    const auto& at = expected.rows[i];
    const bool end = i == 0 || i + 1 == program.rows.size();
    EXPECT_NEAR(row.length_mm, at.length_mm,
                5 * sigma.length_mm + floor.length_mm + (end ? floor.end_mm : 0.0))
        << "length " << i;
    if (i + 1 == program.rows.size()) break;
    EXPECT_LE(RotationError(row.rotation_deg, at.rotation_deg),
              5 * sigma.rotation_deg + floor.angle_deg)
        << "rotation " << i << ": " << row.rotation_deg << ", true " << at.rotation_deg;
    EXPECT_NEAR(row.angle_deg, at.angle_deg, 5 * sigma.angle_deg + floor.angle_deg)
        << "angle " << i;
    EXPECT_NEAR(*row.bend_radius_mm, *at.bend_radius_mm,
                5 * *sigma.bend_radius_mm + 0.01 * *at.bend_radius_mm)
        << "bend radius " << i;
  }
}

// Two measurements of the same tube agree, whichever end each begins at.
inline void ExpectAlike(const pipeline::Measurement& a, const pipeline::Measurement& b,
                        const hal::Tube& b_truth, double length_mm, double angle_deg,
                        bool a_backward) {
  ASSERT_EQ(a.tube.program.bend_count(), b.tube.program.bend_count());
  const bool turned = RunsBackward(b.tube, b_truth) != a_backward;
  const hal::BendProgram other = turned ? Reversed(b.tube.program) : b.tube.program;
  for (std::size_t i = 0; i < other.rows.size(); ++i) {
    EXPECT_NEAR(a.tube.program.rows[i].length_mm, other.rows[i].length_mm, length_mm) << i;
    EXPECT_LE(RotationError(a.tube.program.rows[i].rotation_deg, other.rows[i].rotation_deg),
              angle_deg)
        << i;
    EXPECT_NEAR(a.tube.program.rows[i].angle_deg, other.rows[i].angle_deg, angle_deg) << i;
  }
}

}  // namespace bendloop::tests
