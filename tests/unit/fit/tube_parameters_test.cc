// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_parameters.h"

#include <gtest/gtest.h>

#include "pipeline/fit/surface_sums.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Random;
using tests::Uniform;

Eigen::Matrix3d AxesOf(const hal::SpineSegment& segment) {
  Eigen::Matrix3d axes;
  axes << segment.tangent, segment.normal.cross(segment.tangent), segment.normal;
  return axes;
}

std::vector<hal::SpineSegment> SegmentsAt(const TubeParameters& parameters,
                                          const Eigen::VectorXd& at) {
  const hal::Tube tube = parameters.TubeAt(at);
  return hal::SpineSegments(tube.program, tube.X_WT);
}

// Local state's derivative by parameter `p`, by central differences.
Eigen::Matrix<double, 8, 1> Numeric(const TubeParameters& parameters, const Eigen::VectorXd& at,
                                    int p, std::size_t k) {
  const double step = 1e-5;
  Eigen::VectorXd low = at, high = at;
  low[p] -= step;
  high[p] += step;
  const auto middle = SegmentsAt(parameters, at)[k];
  const auto before = SegmentsAt(parameters, low)[k];
  const auto after = SegmentsAt(parameters, high)[k];
  const Eigen::Matrix3d to_local = AxesOf(middle).transpose();
  const Eigen::Matrix3d spin = (AxesOf(after) - AxesOf(before)) / (2 * step) * to_local;
  const Eigen::Vector3d omega(spin(2, 1) - spin(1, 2), spin(0, 2) - spin(2, 0),
                              spin(1, 0) - spin(0, 1));
  Eigen::Matrix<double, 8, 1> derivative;
  derivative << to_local * (after.start_mm - before.start_mm) / (2 * step),
      0.5 * (to_local * omega), (after.bend_radius_mm - before.bend_radius_mm) / (2 * step),
      (parameters.TubeAt(high).pipe_radius_mm - parameters.TubeAt(low).pipe_radius_mm) / (2 * step);
  return derivative;
}

hal::Tube AnyTube(int bends, Random& random) {
  return tests::RandomTube({.pipe_radius_mm = Uniform(random, 2, 20),
                            .bends = bends,
                            .max_angle_deg = 240,
                            .one_bend_radius = false},
                           random);
}

TEST(TubeParameters, FrameDerivativesAreThoseOfTheSegments) {
  Random random(1);
  for (int run = 0; run < 24; ++run) {
    const hal::Tube tube = AnyTube(run % 6, random);
    const TubeParameters parameters(tube, run % 2 == 0);
    const Eigen::VectorXd at = parameters.Initial();
    const auto segments = SegmentsAt(parameters, at);
    const auto derivatives = parameters.FrameDerivatives(segments);
    ASSERT_EQ(derivatives.size(), segments.size());
    const double size = hal::SpineLength(tube.program);
    for (std::size_t k = 0; k < segments.size(); ++k) {
      ASSERT_EQ(derivatives[k].rows(), kLocalState);
      ASSERT_EQ(derivatives[k].cols(), parameters.size());
      for (int p = 0; p < parameters.size(); ++p) {
        const auto numeric = Numeric(parameters, at, p, k);
        EXPECT_LT((derivatives[k].col(p).head<8>() - numeric).norm(), 1e-7 * size)
            << "run " << run << " segment " << k << " parameter " << p << "\nanalytic "
            << derivatives[k].col(p).transpose() << "\nnumeric " << numeric.transpose();
      }
    }
  }
}

// No point feels it, so a fit must leave it where it is: what rounding makes of it is another frame
// on each processor, and what is looked at in that frame (the tube's ends) another number.
TEST(TubeParameters, AStraightDoesNotRoll) {
  Random random(7);
  constexpr int kRoll = 2;
  for (int run = 0; run < 20; ++run) {
    const hal::Tube tube = AnyTube(0, random);
    const TubeParameters parameters(tube, run % 2 == 0);
    Eigen::VectorXd at = parameters.Initial();
    const auto derivatives = parameters.FrameDerivatives(SegmentsAt(parameters, at));
    ASSERT_EQ(derivatives.size(), 1u);
    EXPECT_EQ(derivatives[0].col(kRoll).norm(), 0.0);
    at[kRoll] = 1.0;
    EXPECT_LT(parameters.TubeAt(at).X_WT.orientation.angularDistance(tube.X_WT.orientation), 1e-7);
  }
}

TEST(TubeParameters, InitialIsTheReference) {
  Random random(2);
  for (int run = 0; run < 20; ++run) {
    const hal::Tube tube = AnyTube(run % 7, random);
    const TubeParameters parameters(tube, true);
    const hal::Tube back = parameters.TubeAt(parameters.Initial());
    EXPECT_DOUBLE_EQ(back.pipe_radius_mm, tube.pipe_radius_mm);
    EXPECT_NEAR((back.X_WT.position_mm - tube.X_WT.position_mm).norm(), 0, 1e-12);
    EXPECT_LT(back.X_WT.orientation.angularDistance(tube.X_WT.orientation), 1e-7);
    ASSERT_EQ(back.program.rows.size(), tube.program.rows.size());
    for (std::size_t i = 0; i < back.program.rows.size(); ++i) {
      EXPECT_NEAR(back.program.rows[i].length_mm, tube.program.rows[i].length_mm, 1e-10);
      EXPECT_NEAR(back.program.rows[i].rotation_deg, tube.program.rows[i].rotation_deg, 1e-10);
      EXPECT_NEAR(back.program.rows[i].angle_deg, tube.program.rows[i].angle_deg, 1e-10);
    }
  }
}

TEST(TubeParameters, EveryPlaceIsUsedOnce) {
  Random random(3);
  const TubeParameters parameters(AnyTube(4, random), true);
  std::vector<int> used(static_cast<std::size_t>(parameters.size()), 0);
  for (std::size_t p = 0; p < 5; ++p) ++used[p];
  const auto use = [&used](int p) {
    if (p >= 0) ++used.at(static_cast<std::size_t>(p));
  };
  use(parameters.pipe_radius());
  for (std::size_t i = 0; i < 4; ++i) {
    for (const int p : {parameters.length(i), parameters.rotation(i), parameters.angle(i),
                        parameters.bend_radius(i)}) {
      use(p);
    }
  }
  EXPECT_EQ(used, std::vector<int>(used.size(), 1));
  EXPECT_EQ(parameters.rotation(0), -1);
  EXPECT_EQ(TubeParameters(AnyTube(4, random), false).pipe_radius(), -1);
}

TEST(TubeParameters, RotationsWrap) {
  Random random(4);
  const TubeParameters parameters(AnyTube(2, random), true);
  Eigen::VectorXd at = parameters.Initial();
  at[parameters.rotation(1)] = 200 / tests::kDegrees;
  EXPECT_NEAR(parameters.TubeAt(at).program.rows[1].rotation_deg, -160, 1e-9);
}

}  // namespace
}  // namespace bendloop::pipeline
