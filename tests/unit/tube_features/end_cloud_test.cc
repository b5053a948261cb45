// SPDX-License-Identifier: Apache-2.0
// Ends of tubes of which only a cloud is known: no pass, no ray, no sensor.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/features/end_cut.h"
#include "pipeline/fit/tube_ends.h"
#include "tests/support/cut_walls.h"
#include "tests/support/error_sigmas.h"

namespace bendloop::pipeline {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Random = std::mt19937_64;
using tests::LogUniform;
using tests::Uniform;

// What a scan of a straight tube is like.
struct Cloud {
  double radius_mm = 8, per_mm2 = 2;
  double noise_mm = 0.03;  // across the wall
  double along = 1;        // the same along the tube, of that
  double slope = 0;        // of the cut at its end
  double wave_mm = 0;      // of its border, twice in a turn
  // A side of its end that something hides: so much of the turn, from so far before the end; where
  // the shadow begins it is as steep as that [mm of the tube over its whole width].
  double hidden_part = 0, hidden_mm = 0, steep_mm = 0;
  // Pressed in so deep, most of it so far before the end; 1 sigma along the tube and around it.
  double dent_mm = 0, dent_before_mm = 0, dent_along_mm = 1, dent_around_rad = 1;
  double wall_mm = 0;     // of which the cut shows so much
  double noise_told = 1;  // the noise that is told, of it: dents and bows elsewhere raise that
  double aside_mm = 0;    // the tube bows: a radius before the end its axis lies so far aside

  double length_mm() const { return 12 * radius_mm; }
  // Samples in 1 sigma of noise along the tube, about its border.
  double AboutBorder() const {
    return along * noise_mm * per_mm2 * 2 * std::numbers::pi * radius_mm;
  }
  // Least 1 sigma of a square end (Cramer and Rao: pipeline/features/README.md).
  double BoundMm() const { return along * noise_mm / std::sqrt(0.903 * AboutBorder()); }
};

// Along x from 0.
Points Scan(const Cloud& cloud, Random& random) {
  std::normal_distribution<double> noise(0, cloud.noise_mm);
  const double to_mm = cloud.length_mm() * 1.3;
  const double area = 2 * std::numbers::pi * cloud.radius_mm * to_mm;
  Points points;
  for (int i = 0; i < static_cast<int>(cloud.per_mm2 * area); ++i) {
    const double around = Uniform(random, -std::numbers::pi, std::numbers::pi);
    const double at_mm = Uniform(random, 0, to_mm);
    const double end_mm = cloud.length_mm() +
                          cloud.radius_mm * cloud.slope * std::cos(around - 0.4) +
                          cloud.wave_mm * std::cos(2 * around);
    const double turn = (around + std::numbers::pi) / (2 * std::numbers::pi);
    const bool is_hidden =
        turn < cloud.hidden_part &&
        at_mm > cloud.length_mm() - cloud.hidden_mm +
                    cloud.steep_mm * (turn / std::max(1e-9, cloud.hidden_part) - 0.5);
    if (at_mm > end_mm || is_hidden) continue;
    const double of_dent =
        std::pow((cloud.length_mm() - cloud.dent_before_mm - at_mm) / cloud.dent_along_mm, 2) +
        std::pow(around / cloud.dent_around_rad, 2);
    const double r_mm = cloud.radius_mm - cloud.dent_mm * std::exp(-0.5 * of_dent) + noise(random);
    const double aside_mm =
        cloud.aside_mm * std::pow((cloud.length_mm() - at_mm) / cloud.radius_mm, 2);
    points.emplace_back(at_mm + cloud.along * noise(random), r_mm * std::cos(around) + aside_mm,
                        r_mm * std::sin(around));
  }
  const double of_face = 2 * std::numbers::pi * cloud.radius_mm * cloud.wall_mm;
  for (int i = 0; i < static_cast<int>(cloud.per_mm2 * of_face); ++i) {
    const double around = Uniform(random, -std::numbers::pi, std::numbers::pi);
    const double r_mm = cloud.radius_mm - Uniform(random, 0, cloud.wall_mm);
    points.emplace_back(cloud.length_mm() + noise(random), r_mm * std::cos(around),
                        r_mm * std::sin(around));
  }
  return points;
}

struct FoundEnd {
  double off_mm = 0, sigma_mm = 1;
  bool is_oblique = false;
  double sigmas() const { return off_mm / sigma_mm; }
};

FoundEnd FindLastEnd(const Cloud& cloud, Random& random) {
  const hal::Tube tube{cloud.radius_mm, {{{cloud.length_mm() * 1.02, 0, 0, std::nullopt}}}, {}};
  const Points points = Scan(cloud, random);
  const Eigen::Vector3d middle_mm(0.5 * cloud.length_mm(), 0, 0);
  const std::vector<PointBlock> blocks = {{middle_mm, cloud.length_mm(), points}};
  const double noise_mm = cloud.noise_told * cloud.noise_mm;
  TubeEnds ends = FindTubeEnds(tube, noise_mm, blocks);
  const EndCuts cuts = FindEndCuts(noise_mm, blocks, ends);
  const double end_mm = ends.tube.X_WT.position_mm.x() + ends.tube.program.rows.back().length_mm;
  FoundEnd found{end_mm - cloud.length_mm(), ends.last_sigma_mm, false};
  found.is_oblique = cuts.last && cuts.last->cut.obliquity_deg > 5 * cuts.last->obliquity_sigma_deg;
  return found;
}

// Of the end's place, which is told as such a cut and is not far beyond what it says.
double SigmasOff(const Cloud& cloud, bool is_oblique, Random& random) {
  const FoundEnd end = FindLastEnd(cloud, random);
  EXPECT_EQ(end.is_oblique, is_oblique);
  EXPECT_LT(std::abs(end.off_mm), 6 * end.sigma_mm) << "off " << end.off_mm;
  return end.sigmas();
}

// Noise in all directions moves samples beyond the end, noise along rays hardly does; nobody says
// which it is.
class SquareEnd : public testing::TestWithParam<double> {};

TEST_P(SquareEnd, OfACloudIsAsFarOffAsItSays) {
  Random random(7);
  tests::ErrorSigmas all, dense;
  double over_bound = 0;
  int oblique = 0;
  for (int i = 0; i < 100; ++i) {
    Cloud cloud;
    cloud.radius_mm = LogUniform(random, 3.0, 20.0);
    cloud.noise_mm = LogUniform(random, 0.01, 0.1);
    cloud.per_mm2 = LogUniform(random, 1.0, 30.0);
    cloud.along = GetParam();
    const double area = 24 * std::numbers::pi * std::pow(cloud.radius_mm, 2);
    cloud.per_mm2 = std::min(cloud.per_mm2, 60'000 / area);
    const FoundEnd end = FindLastEnd(cloud, random);
    oblique += end.is_oblique ? 1 : 0;
    EXPECT_LT(std::abs(end.sigmas()), 5) << i;
    all.Add(end.sigmas());
    if (cloud.AboutBorder() < 10) continue;
    dense.Add(end.sigmas());
    over_bound = std::max(over_bound, end.sigma_mm / cloud.BoundMm());
  }
  EXPECT_LE(oblique, 1);  // of 400 one is
  EXPECT_LT(all.rms(), 1.3);
  EXPECT_GT(all.rms(), 0.7);
  EXPECT_LT(std::abs(all.mean()), 0.4);
  if (dense.count() < 10) return;
  EXPECT_LT(dense.rms(), 1.6);  // of so few it is known to a fifth
  EXPECT_LT(std::abs(dense.mean()), 0.2 + 2.0 / std::sqrt(dense.count()));
  EXPECT_LT(over_bound, 2.0);
}
INSTANTIATE_TEST_SUITE_P(NoiseAlong, SquareEnd, testing::Values(0.0, 0.3, 0.6, 1.0));

// One side of the end lies in the tube's own shadow: samples stop before it there.
TEST(EndInShadow, IsWhereTheOtherSidesEnd) {
  Random random(8);
  tests::ErrorSigmas errors;
  for (int i = 0; i < 60; ++i) {
    Cloud cloud;
    cloud.radius_mm = LogUniform(random, 3.0, 20.0);
    cloud.per_mm2 = Uniform(random, 100, 900) / std::pow(cloud.radius_mm, 2);
    cloud.hidden_part = Uniform(random, 0.2, 0.65);
    cloud.hidden_mm = cloud.radius_mm * Uniform(random, 0.8, 2.5);
    cloud.steep_mm = cloud.hidden_mm * Uniform(random, -1, 1);
    SCOPED_TRACE(i);
    errors.Add(SigmasOff(cloud, false, random));
  }
  EXPECT_LT(errors.rms(), 1.4);
}

// A dent right before the end takes the wall away from there on one side: what it pressed in still
// shows that the tube goes on. (Some of these were oblique cuts, bevels or shadows, up to 16 mm
// short.)
TEST(DentedEnd, IsWhereTheOtherSidesEnd) {
  Random random(11);
  tests::ErrorSigmas errors;
  for (int i = 0; i < 100; ++i) {
    Cloud cloud;
    cloud.radius_mm = LogUniform(random, 3.0, 20.0);
    cloud.per_mm2 = Uniform(random, 40, 400) / std::pow(cloud.radius_mm, 2);
    cloud.dent_mm = cloud.radius_mm * Uniform(random, 0.1, 0.25);
    cloud.dent_along_mm = cloud.radius_mm * Uniform(random, 0.3, 0.6);
    cloud.dent_around_rad = Uniform(random, 0.5, 1.0);
    cloud.dent_before_mm = cloud.radius_mm * Uniform(random, 0.0, 0.5);
    SCOPED_TRACE(i);
    errors.Add(SigmasOff(cloud, false, random));
  }
  EXPECT_LT(errors.rms(), 1.5);
}

// Farther from the end a dent leaves the wall beside it, and its face is seen: without the samples
// that may be of the face, which are those of the wall's upper half, so few are left that the end
// was told where the dent begins, or as an oblique cut.
TEST(DentedEnd, IsWhereItsFaceIs) {
  Random random(12);
  tests::ErrorSigmas errors;
  for (int i = 0; i < 100; ++i) {
    Cloud cloud;
    cloud.radius_mm = LogUniform(random, 5.0, 20.0);
    cloud.noise_mm = cloud.radius_mm * LogUniform(random, 0.001, 0.004);
    cloud.per_mm2 = Uniform(random, 60, 150) / std::pow(cloud.radius_mm, 2);
    cloud.wall_mm = cloud.radius_mm * Uniform(random, 0.08, 0.15);
    cloud.dent_mm = cloud.radius_mm * Uniform(random, 0.05, 0.15);
    cloud.dent_along_mm = cloud.radius_mm * Uniform(random, 0.4, 1.0);
    cloud.dent_around_rad = Uniform(random, 0.4, 1.0);
    cloud.dent_before_mm = cloud.radius_mm * Uniform(random, 1.5, 4.0);
    cloud.aside_mm = cloud.noise_mm * Uniform(random, -0.2, 0.2);
    cloud.noise_told = Uniform(random, 1.0, 6.0);
    SCOPED_TRACE(i);
    errors.Add(SigmasOff(cloud, false, random));
  }
  EXPECT_LT(errors.rms(), 1.5);
}

// A border that is cut in waves is no shadow either.
TEST(EndInShadow, IsNoneWhereABorderIsCutInWaves) {
  Random random(10);
  for (int i = 0; i < 20; ++i) {
    Cloud cloud;
    cloud.per_mm2 = Uniform(random, 150, 900) / std::pow(cloud.radius_mm, 2);
    cloud.wave_mm = cloud.radius_mm * Uniform(random, 0.2, 0.8);
    EXPECT_LT(std::abs(FindLastEnd(cloud, random).off_mm), 0.05 * cloud.wave_mm) << i;
  }
}

// Where samples stop at a plane all round it is the cut.
TEST(EndInShadow, IsNoneWhereACutIsOblique) {
  Random random(9);
  tests::ErrorSigmas errors;
  for (int i = 0; i < 60; ++i) {
    Cloud cloud;
    cloud.radius_mm = LogUniform(random, 3.0, 20.0);
    cloud.per_mm2 = Uniform(random, 40, 900) / std::pow(cloud.radius_mm, 2);
    cloud.slope = std::tan(Uniform(random, 10, 50) * hal::kRadiansPerDegree);
    SCOPED_TRACE(i);
    errors.Add(SigmasOff(cloud, true, random));
  }
  EXPECT_LT(errors.rms(), 1.3);
}

}  // namespace
}  // namespace bendloop::pipeline
