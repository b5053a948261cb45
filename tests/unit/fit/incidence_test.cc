// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/incidence.h"

#include <gtest/gtest.h>

#include "pipeline/fit/surface_fit.h"
#include "tests/support/shapes.h"

namespace bendloop::pipeline {
namespace {

using tests::Points;
using tests::Random;
using tests::Uniform;

TEST(SensorDirection, ComesBackFromFourBytes) {
  static_assert(sizeof(SensorDirection) == 4);
  Random random(1);
  const auto expect_back = [](const Eigen::Vector3d& direction) {
    const SensorDirection packed = PackDirection(direction);
    ASSERT_TRUE(packed.known());
    const UnpackedDirection back = UnpackDirection(packed);
    EXPECT_LT((Eigen::Vector3d(back.x, back.y, back.z) - direction.normalized()).norm(), 1e-4)
        << direction.transpose();
  };
  for (int run = 0; run < 2000; ++run) {
    expect_back(std::exp(Uniform(random, -20, 20)) * tests::RandomUnit(random));
  }
  for (int i = 0; i < 27; ++i) {
    const Eigen::Vector3d corner(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    if (i != 13) expect_back(corner);
  }
  for (const double bad : {0.0, std::nan(""), 1e308 * 10}) {
    EXPECT_FALSE(PackDirection(Eigen::Vector3d::Constant(bad)).known());
  }
  EXPECT_FALSE(SensorDirection{}.known());
}

// Distances as a sensor far above a pipe has them: rays spread evenly over its width.
NoiseByIncidence Noise(std::size_t points, double growth, Random& random) {
  std::normal_distribution<double> normal;
  NoiseByIncidence noise;
  for (std::size_t i = 0; i < points; ++i) {
    const double aside = Uniform(random, -0.97, 0.97);
    const double cosine = std::sqrt(1 - aside * aside);
    noise.Add(NoiseByIncidence::CodeOf(cosine), 0.05 * std::pow(cosine, -growth) * normal(random));
  }
  return noise;
}

TEST(NoiseByIncidence, NoiseThatIsAlikeIsLeftAlone) {
  Random random(2);
  for (int run = 0; run < 100; ++run) {
    const std::size_t points = run % 2 == 0 ? 3000 : 30'000;
    EXPECT_FALSE(Noise(points, 0, random).Certainties()) << run;
  }
  EXPECT_FALSE(NoiseByIncidence{}.Certainties());
  EXPECT_FALSE(Noise(150, 2, random).Certainties()) << "too few to tell";
}

TEST(NoiseByIncidence, LearnsWhatGrowsAndWhatShrinks) {
  Random random(3);
  for (const double growth : {-1.0, 1.0, 2.0}) {
    const NoiseByIncidence noise = Noise(20'000, growth, random);
    const auto certainties = noise.Certainties();
    ASSERT_TRUE(certainties);
    const auto at = [&](double cosine) { return (*certainties)[NoiseByIncidence::CodeOf(cosine)]; };
    for (const double cosine : {0.35, 0.5, 0.8}) {
      EXPECT_NEAR(at(0.95) / at(cosine), std::pow(0.95 / cosine, growth),
                  0.12 * std::pow(0.95 / cosine, growth))
          << growth << ' ' << cosine;
    }
    EXPECT_EQ((*certainties)[0], 1.0F) << "of what is not known";
  }
}

// A pipe around x seen from above, its points displaced along the rays by any amount: certainties
// go by the rays, not by where the noise put the points.
TEST(WeighByIncidence, GoesByTheRay) {
  Random random(4);
  std::normal_distribution<double> normal;
  hal::Tube tube{5, {{{100, 0, 0, std::nullopt}}}, {}};
  Points points;
  std::vector<double> cosines;
  std::vector<SensorDirection> to_sensor;
  for (int i = 0; i < 20'000; ++i) {
    const double aside = Uniform(random, -0.97, 0.97);
    cosines.push_back(std::sqrt(1 - aside * aside));
    const double noise = 0.05 / std::pow(cosines.back(), 2) * normal(random);
    points.emplace_back(Uniform(random, 0, 100), 5 * aside, 5 * cosines.back() + noise);
    to_sensor.push_back(i % 100 == 0 ? SensorDirection{} : PackDirection({0, 0, 300}));
  }
  std::vector<PointBlock> blocks = {{{50, 0, 0}, 60, points, {}, to_sensor}};
  const IncidenceWeights weights = WeighByIncidence(tube, {}, 0.06, 1.0, blocks);
  ASSERT_EQ(blocks[0].certainties.size(), points.size());
  double squares = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double certainty = blocks[0].certainties[i];
    squares += certainty * certainty / 20'000;
    if (i % 100 == 0) {
      EXPECT_EQ(certainty, 1.0);
    } else if (cosines[i] > 0.4) {
      // The noise along the normal grows with 1 / cosine.
      const double mean = blocks[0].certainties[1] / cosines[1];
      EXPECT_NEAR(certainty / cosines[i], mean, 0.2 * mean) << cosines[i];
    }
  }
  EXPECT_NEAR(squares, 1, 0.02);
  EXPECT_NEAR(weights.noise_mm, 0.06, 0.015);

  blocks = {{{50, 0, 0}, 60, points}};
  EXPECT_TRUE(WeighByIncidence(tube, {}, 0.06, 1.0, blocks).certainties.empty());
  EXPECT_TRUE(blocks[0].certainties.empty());
}

hal::Tube BentTube(Random& random) {
  return tests::RandomTube({.pipe_radius_mm = 4, .bends = 2, .min_angle_deg = 40}, random);
}

// Every second point is four times as uncertain.
struct TwoKinds {
  TwoKinds(const hal::Tube& tube, std::size_t count, Random& random)
      : points(tests::SyntheticCloud(tube, {.points = count, .noise_mm = 0.02}, random)) {
    const Points worse = tests::SyntheticCloud(tube, {.points = count, .noise_mm = 0.08}, random);
    for (std::size_t i = 0; i < count; i += 2) points[i] = worse[i];
    for (std::size_t i = 0; i < count; ++i) {
      certainties.push_back(std::sqrt(2.0F / 17.0F) * (i % 2 == 0 ? 1.0F : 4.0F));
    }
  }
  OwnedBlocks Weighted() const { return tests::Blocks(points, 4, certainties); }
  OwnedBlocks Alike() const { return tests::Blocks(points, 4); }

  Points points;
  std::vector<float> certainties;
};

TEST(WeightedFit, CertaintiesOfOneChangeNoBit) {
  Random random(5);
  const hal::Tube tube = BentTube(random);
  for (const std::size_t count : {3000U, 45'000U}) {
    const TwoKinds scan(tube, count, random);
    const OwnedBlocks alike = scan.Alike();
    const OwnedBlocks weighted = tests::Blocks(scan.points, 4, std::vector<float>(count, 1.0F));
    const SurfaceFit a = FitSurface(tube, alike, {.reach_mm = 0.8});
    const SurfaceFit b = FitSurface(tube, weighted, {.reach_mm = 0.8});
    EXPECT_EQ(a.tube.program, b.tube.program);
    EXPECT_EQ(a.sigma, b.sigma);
    EXPECT_EQ(a.cost_mm2, b.cost_mm2);
    const SurfaceFit half_a = FitSurface(tube, HalvesOf(alike, 5000).front(), {.reach_mm = 0.8});
    const SurfaceFit half_b = FitSurface(tube, HalvesOf(weighted, 5000).front(), {.reach_mm = 0.8});
    EXPECT_EQ(half_a.tube.program, half_b.tube.program);
    EXPECT_EQ(half_a.sigma, half_b.sigma);
  }
}

// Weights as they are right make the errors as small as they can be, and sigma says how small: of
// points at once, of a walk over many, and of their halves. The variance of the mean falls to 2/9.
TEST(WeightedFit, IsMoreExactAndSaysSo) {
  Random random(6);
  const hal::Tube tube = BentTube(random);
  const SurfaceFitOptions options{.reach_mm = 0.8};
  for (const bool many : {false, true}) {
    const int runs = many ? 3 : 20;
    double weighted2 = 0, alike2 = 0, half2 = 0, values = 0;
    for (int run = 0; run < runs; ++run) {
      const TwoKinds scan(tube, many ? 45'000 : 3000, random);
      const OwnedBlocks weighted = scan.Weighted();
      const SurfaceFit fit = FitSurface(tube, weighted, options);
      const SurfaceFit alike = FitSurface(tube, scan.Alike(), options);
      const SurfaceFit half = FitSurface(tube, HalvesOf(weighted, 5000).front(), options);
      EXPECT_NEAR(fit.sigma_mm, 0.02 * std::sqrt(2.0 / (1 + 1.0 / 16)), 0.002);
      const auto add = [&](auto value) {
        const double truth = value(tube), sigma = value(hal::Tube{0, fit.sigma, {}});
        weighted2 += std::pow((value(fit.tube) - truth) / sigma, 2);
        alike2 += std::pow((value(alike.tube) - truth) / sigma, 2);
        half2 += std::pow((value(half.tube) - truth) / value(hal::Tube{0, half.sigma, {}}), 2);
        values += 1;
      };
      for (const std::size_t i : {0U, 1U}) {
        add([i](const hal::Tube& t) { return t.program.rows[i].angle_deg; });
        add([i](const hal::Tube& t) { return *t.program.rows[i].bend_radius_mm; });
      }
      add([](const hal::Tube& t) { return t.program.rows[1].length_mm; });
    }
    // Chi square of 15 or 100 degrees of freedom, not all independent.
    EXPECT_NEAR(weighted2 / values, 1, many ? 0.8 : 0.45);
    EXPECT_NEAR(half2 / values, 1, many ? 0.8 : 0.45);
    EXPECT_GT(alike2 / weighted2, 2.0);
  }
}

}  // namespace
}  // namespace bendloop::pipeline
