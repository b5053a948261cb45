// SPDX-License-Identifier: Apache-2.0
// A processor without AVX2 and FMA rounds its sums differently: the result differs by no more than
// pipeline/math/README.md says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "hal/clock.h"
#include "pipeline/math/simd.h"
#include "pipeline/reconstruction.h"
#include "tests/support/synthetic_cloud.h"
#include "tests/support/synthetic_tube.h"

namespace bendloop::pipeline {
namespace {

class PortableLoops {
 public:
  PortableLoops() { uses_avx2 = false; }
  ~PortableLoops() { uses_avx2 = before_; }

 private:
  bool before_ = uses_avx2;
};

struct Difference {
  double mm = 0, deg = 0;
  double sigmas = 0;
  void Length(double a, double b, double sigma) {
    mm = std::max(mm, std::abs(a - b));
    sigmas = std::max(sigmas, std::abs(a - b) / sigma);
  }
  void Angle(double a, double b, double sigma) {
    const double d = std::abs(std::remainder(a - b, 360.0));
    deg = std::max(deg, d);
    sigmas = std::max(sigmas, d / sigma);
  }
};

hal::Tube RandomTube(support::Rng& random, int bends) {
  hal::Tube tube;
  tube.pipe_radius_mm = support::Uniform(random, 3, 10);
  tube.program = support::RandomProgram(random, bends);
  tube.X_WT = support::RandomPose(random);
  return tube;
}

TEST(PortableLoops, GiveTheSameTube) {
  if (!uses_avx2) GTEST_SKIP() << "no AVX2 and FMA here: there is one version only";
  const hal::ManualClock clock;
  Difference greatest;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    std::mt19937_64 random(seed);
    const hal::Tube tube = RandomTube(random, 1 + static_cast<int>(seed % 4));
    const auto cloud =
        tests::SyntheticCloud(tube, {.points = 6005, .noise_mm = 0.05, .fliers = 0.01}, random);
    const auto fast = Reconstruct(cloud, {}, clock);
    const auto portable = [&] {
      const PortableLoops choice;
      return Reconstruct(cloud, {}, clock);
    }();
    ASSERT_TRUE(fast && portable) << seed;
    const auto &a = fast->tube.program.rows, &b = portable->tube.program.rows;
    const auto& sigma = fast->sigma.rows;
    ASSERT_EQ(a.size(), b.size()) << seed;
    for (std::size_t i = 0; i < a.size(); ++i) {
      greatest.Length(a[i].length_mm, b[i].length_mm, sigma[i].length_mm);
      if (i + 1 == a.size()) break;
      greatest.Angle(a[i].angle_deg, b[i].angle_deg, sigma[i].angle_deg);
      if (i > 0) greatest.Angle(a[i].rotation_deg, b[i].rotation_deg, sigma[i].rotation_deg);
    }
  }
  EXPECT_LT(greatest.mm, 1e-6);
  EXPECT_LT(greatest.deg, 1e-6);
  EXPECT_LT(greatest.sigmas, 1e-4);
}

}  // namespace
}  // namespace bendloop::pipeline
