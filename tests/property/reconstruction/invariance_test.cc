// SPDX-License-Identifier: Apache-2.0
// What must not change the result: where the tube lies, the order of its points, when they came.
#include <array>
#include <cstring>
#include <map>

#include "firmware-host/workers/thread_workers.h"
#include "hal/laser_profile.h"
#include "tests/property/reconstruction/scans.h"

namespace bendloop::tests {
namespace {

using pipeline::Measurement;

constexpr int kFew = std::max(1, kSeeds / 4);

hal::Tube SomeTube(Random& random, int bends) {
  return RandomTube({.bends = bends,
                     .min_bend_radius = 2.5,
                     .min_straight = 3.5,
                     .max_straight = 12,
                     .min_angle_deg = 20},
                    random);
}

void ExpectSameBits(const hal::BendProgram& a, const hal::BendProgram& b) {
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    const auto bits = [](const hal::BendRow& row) {
      const std::array<double, 4> values{row.length_mm, row.rotation_deg, row.angle_deg,
                                         row.bend_radius_mm.value_or(-1)};
      std::array<std::uint64_t, 4> out{};
      std::memcpy(out.data(), values.data(), sizeof out);
      return out;
    };
    EXPECT_EQ(bits(a.rows[i]), bits(b.rows[i])) << "row " << i;
  }
}

void ExpectSameBits(const Measurement& a, const Measurement& b) {
  ExpectSameBits(a.tube.program, b.tube.program);
  ExpectSameBits(a.sigma, b.sigma);
  EXPECT_EQ(a.tube.pipe_radius_mm, b.tube.pipe_radius_mm);
  EXPECT_EQ(a.tube.X_WT.position_mm, b.tube.X_WT.position_mm);
  EXPECT_EQ(a.tube.X_WT.orientation.coeffs(), b.tube.X_WT.orientation.coeffs());
  EXPECT_EQ(a.noise_mm, b.noise_mm);
  EXPECT_EQ(a.coverage, b.coverage);
  EXPECT_EQ(a.fit.samples, b.fit.samples);
  EXPECT_EQ(a.fit.outliers, b.fit.outliers);
  EXPECT_EQ(a.fit.rms_distance_mm, b.fit.rms_distance_mm);
  ASSERT_EQ(a.surface.size(), b.surface.size());
  for (std::size_t i = 0; i < a.surface.size(); ++i) {
    ASSERT_EQ(a.surface[i].position_mm, b.surface[i].position_mm);
    ASSERT_EQ(a.surface[i].distance_mm, b.surface[i].distance_mm);
  }
  ASSERT_EQ(a.spine.size(), b.spine.size());
  for (std::size_t i = 0; i < a.spine.size(); ++i) {
    ASSERT_EQ(a.spine[i].position_mm, b.spine[i].position_mm);
    ASSERT_EQ(a.spine[i].pipe_radius_mm, b.spine[i].pipe_radius_mm);
  }
  EXPECT_EQ(a.longest_gap_mm, b.longest_gap_mm);
  EXPECT_EQ(a.pipe_radius_sigma_mm, b.pipe_radius_sigma_mm);
  EXPECT_EQ(a.fit.median_abs_distance_mm, b.fit.median_abs_distance_mm);
  EXPECT_EQ(a.fit.p95_abs_distance_mm, b.fit.p95_abs_distance_mm);
  EXPECT_EQ(a.structure_margin, b.structure_margin);
  EXPECT_EQ(a.halves_differ_sigma, b.halves_differ_sigma);
  EXPECT_EQ(a.warnings, b.warnings);
}

// But for the tube's ends: where rays are known, so is that noise hardly moves samples along the
// tube; of a cloud nobody knows, and its ends are elsewhere by that.
void ExpectSameBitsButEnds(const Measurement& a, const Measurement& b) {
  const auto without = [](hal::BendProgram program) {
    program.rows.front().length_mm = program.rows.back().length_mm = 0;
    return program;
  };
  ExpectSameBits(without(a.tube.program), without(b.tube.program));
  ExpectSameBits(without(a.sigma), without(b.sigma));
  EXPECT_EQ(a.tube.pipe_radius_mm, b.tube.pipe_radius_mm);
  EXPECT_EQ(a.noise_mm, b.noise_mm);
  EXPECT_EQ(a.structure_margin, b.structure_margin);
  EXPECT_EQ(a.halves_differ_sigma, b.halves_differ_sigma);
}

// Few points, and so many that all loops are shared.
TEST(Invariance, AnyNumberOfThreadsSameBytes) {
  for (const std::size_t points : {5000U, 120'000U}) {
    SCOPED_TRACE(points);
    Random random(points);
    const hal::Tube tube = SomeTube(random, 2);
    const Points cloud =
        SyntheticCloud(tube, {.points = points, .noise_mm = 0.03, .fliers = 0.01}, random);
    pipeline::ReconstructionOptions options;
    const auto alone = Measure(cloud, options);
    ASSERT_TRUE(alone);
    for (const std::size_t threads : {2U, 3U}) {
      SCOPED_TRACE(threads);
      host::ThreadWorkers workers(threads);
      const auto shared = Measure(cloud, options, &workers);
      ASSERT_TRUE(shared);
      ExpectSameBits(*alone, *shared);
    }
  }
}

TEST(Invariance, SameInputSameBytes) {
  for (int seed = 0; seed < kFew; ++seed) {
    Random random(static_cast<std::uint64_t>(200 + seed));
    const Points points = SyntheticCloud(SomeTube(random, 1 + seed), {.fliers = 0.01}, random);
    const auto a = Measure(points);
    const auto b = Measure(points);
    ASSERT_TRUE(a && b);
    ExpectSameBits(*a, *b);
  }
}

TEST(Invariance, RigidMotionMovesTheTubeAndNothingElse) {
  for (int seed = 0; seed < kFew; ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(300 + seed));
    const hal::Tube tube = SomeTube(random, 1 + seed);
    const Points points = SyntheticCloud(tube, {.points = 12000, .noise_mm = 0.03}, random);
    const hal::Pose motion = RandomPose(1000, random);
    Points moved;
    for (const Eigen::Vector3d& p : points) moved.push_back(motion * p);
    hal::Tube there = tube;
    there.X_WT = motion * tube.X_WT;
    const auto a = Measure(points);
    const auto b = Measure(moved);
    ASSERT_TRUE(a && b);
    // The choice of samples changes with the grid, the final fit with all points hardly does.
    ExpectAlike(*a, *b, there, 0.02, 0.02, RunsBackward(a->tube, tube));
    EXPECT_NEAR(a->tube.pipe_radius_mm, b->tube.pipe_radius_mm, 0.003);
  }
}

TEST(Invariance, OrderOfThePointsHardlyMatters) {
  for (int seed = 0; seed < kFew; ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(400 + seed));
    const hal::Tube tube = SomeTube(random, 1 + seed);
    Points points = SyntheticCloud(tube, {.points = 12000, .noise_mm = 0.03}, random);
    const auto a = Measure(points);
    std::reverse(points.begin(), points.end());
    const auto b = Measure(points);
    ASSERT_TRUE(a && b);
    ExpectAlike(*a, *b, tube, 0.02, 0.02, RunsBackward(a->tube, tube));
  }
}

// Laser lines across the way of the scan, in the sensor's own frame; so near to each other that
// what moves a point to its line is nothing beside the noise.
std::vector<hal::LaserProfile> ProfilesOf(const Points& points, Random& random) {
  constexpr double kStepMm = 0.02;
  const Eigen::Quaterniond turn = RandomPose(1, random).orientation;
  const Eigen::Vector3d x = turn * Eigen::Vector3d::UnitX();
  const Eigen::Vector3d way = turn * Eigen::Vector3d::UnitY();
  const Eigen::Vector3d z = turn * Eigen::Vector3d::UnitZ();
  std::map<int, Points> lines;
  for (const Eigen::Vector3d& p : points) {
    lines[static_cast<int>(std::floor(p.dot(way) / kStepMm))].push_back(p);
  }
  std::vector<hal::LaserProfile> profiles;
  for (const auto& [line, held] : lines) {
    hal::LaserProfile& profile = profiles.emplace_back();
    profile.sequence = profiles.size();
    profile.X_WS = {kStepMm * line * way - 300 * z, turn};
    for (const Eigen::Vector3d& p : held) {
      const Eigen::Vector3d v = p - profile.X_WS.position_mm;
      profile.points.push_back({static_cast<float>(v.dot(x)), static_cast<float>(v.dot(z))});
    }
  }
  return profiles;
}

// Fed live, with the live view asked for in between, or one after the other: the same to the bit.
// As a cloud the same but for its ends, though only the profiles tell where the sensor was, because
// the noise is the same from wherever.
TEST(Invariance, LiveEqualsBatch) {
  for (int seed = 0; seed < kFew; ++seed) {
    SCOPED_TRACE(seed);
    Random random(static_cast<std::uint64_t>(500 + seed));
    const hal::Tube tube = SomeTube(random, 1 + seed % 4);
    // Few points, so that sparse neighbourhoods occur too.
    const auto profiles = ProfilesOf(
        SyntheticCloud(tube, {.points = seed % 2 == 0 ? 9000U : 2500U, .noise_mm = 0.03}, random),
        random);
    Points all;
    for (const auto& profile : profiles) {
      const Eigen::Matrix3d R = profile.X_WS.orientation.toRotationMatrix();
      for (const auto& p : profile.points) {
        all.push_back(R.col(0) * p.x_mm + R.col(2) * p.z_mm + profile.X_WS.position_mm);
      }
    }
    const hal::ManualClock clock;
    for (const bool radius_known : {true, false}) {
      pipeline::ReconstructionOptions options;
      if (radius_known) options.pipe_radius_mm = tube.pipe_radius_mm;
      pipeline::Reconstruction live(options, clock);
      std::size_t covered = 0;
      for (std::size_t i = 0; i < profiles.size(); ++i) {
        live.Add(profiles[i]);
        if (i % 1000 == 500) {
          const auto view = live.View();
          EXPECT_EQ(view.profiles, i + 1);
          covered = std::max(covered, view.spine_samples);
        }
      }
      EXPECT_EQ(covered > 0, radius_known) << "nothing was projected while the scan ran";
      pipeline::Reconstruction unseen(options, clock);
      for (const auto& profile : profiles) unseen.Add(profile);
      const auto a = live.Finish(), b = unseen.Finish(), of_cloud = Measure(all, options);
      ASSERT_EQ(a.has_value(), b.has_value());
      ASSERT_EQ(a.has_value(), of_cloud.has_value());
      if (!a) continue;
      ExpectSameBits(*a, *b);
      ExpectSameBitsButEnds(*a, *of_cloud);
    }
  }
}

}  // namespace
}  // namespace bendloop::tests
