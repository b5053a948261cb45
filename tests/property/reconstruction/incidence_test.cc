// SPDX-License-Identifier: Apache-2.0
// Scans whose sensor's pose is known: noise that depends on the incidence is learnt and weighed.
#include <array>
#include <functional>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "firmware-host/workers/thread_workers.h"
#include "tests/property/reconstruction/scans.h"

namespace bendloop::tests {
namespace {

using pipeline::Measurement;
using Profiles = std::vector<hal::LaserProfile>;

hal::Tube Part() {
  return drivers::LayOnTable(
      hal::Tube{5, {{{45, 0, 60, 16.0}, {35, 75, 80, 16.0}, {45, 0, 0, std::nullopt}}}, {}}, 3);
}

Profiles Scan(std::uint64_t seed, double noise_growth) {
  drivers::VirtualScanOptions options;
  options.seed = seed;
  options.noise_mm = 0.03;
  options.noise_growth = noise_growth;
  options.rays = 50;
  options.fan_half_angle_deg = 3;
  options.path.profile_spacing_mm = 2;
  options.path.views_deg = drivers::SpreadViewsDeg(2);
  const drivers::VirtualScan scan(Part(), options);
  Profiles profiles(scan.profile_count());
  for (std::size_t i = 0; i < profiles.size(); ++i) scan.Make(i, profiles[i]);
  return profiles;
}

hal::Result<Measurement> MeasureProfiles(const Profiles& profiles,
                                         const pipeline::ReconstructionOptions& options,
                                         std::size_t view_every = 0,
                                         pipeline::Workers* workers = nullptr) {
  const hal::ManualClock clock;
  pipeline::Reconstruction live(options, clock);
  for (std::size_t i = 0; i < profiles.size(); ++i) {
    live.Add(profiles[i]);
    if (view_every > 0 && i % view_every == 0) live.View();
  }
  return live.Finish(workers);
}

Points Cloud(const Profiles& profiles) {
  Points points;
  for (const hal::LaserProfile& profile : profiles) {
    const Eigen::Matrix3d R = profile.X_WS.orientation.toRotationMatrix();
    for (const auto& p : profile.points) {
      points.push_back(R.col(0) * p.x_mm + R.col(2) * p.z_mm + profile.X_WS.position_mm);
    }
  }
  return points;
}

void ExpectSame(const Measurement& a, const Measurement& b) {
  EXPECT_EQ(a.tube.program, b.tube.program);
  EXPECT_EQ(a.sigma, b.sigma);
  EXPECT_EQ(a.tube.pipe_radius_mm, b.tube.pipe_radius_mm);
  EXPECT_EQ(a.tube.X_WT.position_mm, b.tube.X_WT.position_mm);
  EXPECT_EQ(a.noise_mm, b.noise_mm);
  EXPECT_EQ(a.halves_differ_sigma, b.halves_differ_sigma);
  EXPECT_EQ(a.fit.rms_distance_mm, b.fit.rms_distance_mm);
  EXPECT_EQ(a.fit.outliers, b.fit.outliers);
}

#ifndef BENDLOOP_FEW_SEEDS  // figures, no memory errors
// Interior lengths, rotations, angles and radii; first and last length come from the ends.
std::vector<double> Values(const hal::BendProgram& program, double pipe_radius_mm) {
  std::vector<double> values = {pipe_radius_mm};
  for (std::size_t i = 0; i < program.bend_count(); ++i) {
    const hal::BendRow& row = program.rows[i];
    values.push_back(row.angle_deg);
    values.push_back(row.bend_radius_mm.value_or(0));
    if (i > 0) values.push_back(row.length_mm);
    if (i > 0) values.push_back(row.rotation_deg);
  }
  return values;
}

struct Errors {
  double mean_square = 0;             // in units of what the same points say without poses
  double mean_square_over_sigma = 0;  // as reported
};

// With poses beside without, on scans of the same seeds.
Errors Compare(double noise_growth, int scans) {
  const hal::Tube part = Part();
  std::vector<double> with, without, over_sigma;
  const std::function add = [](std::vector<double>& sums, std::size_t i, double value) {
    sums.resize(std::max(sums.size(), i + 1));
    sums[i] += value * value;
  };
  for (int seed = 1; seed <= scans; ++seed) {
    const Profiles profiles = Scan(static_cast<std::uint64_t>(seed), noise_growth);
    pipeline::ReconstructionOptions options;
    options.pipe_radius_mm = part.pipe_radius_mm;
    const auto posed = MeasureProfiles(profiles, options);
    const auto plain = Measure(Cloud(profiles), options);
    EXPECT_TRUE(posed && plain) << seed;
    if (!posed || !plain) continue;
    const bool backward = RunsBackward(posed->tube, part);
    EXPECT_EQ(backward, RunsBackward(plain->tube, part));
    const auto truth = Values(backward ? Reversed(part.program) : part.program, 5);
    const auto a = Values(posed->tube.program, posed->tube.pipe_radius_mm);
    const auto b = Values(plain->tube.program, plain->tube.pipe_radius_mm);
    const auto sigma = Values(posed->sigma, posed->pipe_radius_sigma_mm);
    EXPECT_EQ(a.size(), truth.size()) << seed;
    EXPECT_EQ(b.size(), truth.size()) << seed;
    if (a.size() != truth.size() || b.size() != truth.size()) continue;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      add(with, i, a[i] - truth[i]);
      add(without, i, b[i] - truth[i]);
      add(over_sigma, i, (a[i] - truth[i]) / sigma[i]);
    }
  }
  Errors errors;
  const auto kinds = static_cast<double>(with.size());
  for (std::size_t i = 0; i < with.size(); ++i) {
    errors.mean_square += with[i] / without[i] / kinds;
    errors.mean_square_over_sigma += over_sigma[i] / scans / kinds;
  }
  return errors;
}

constexpr int kScans = 24;

TEST(Incidence, WhatGrowsUncertainWeighsLess) {
  const Errors errors = Compare(3, kScans);
  EXPECT_LT(errors.mean_square, 0.7);
  // Noise that differs around the tube looks a little like a tube that is not round: the sigmas
  // are a sixth too wide.
  EXPECT_GT(errors.mean_square_over_sigma, 0.65);
  EXPECT_LT(errors.mean_square_over_sigma, 1.3);
}

// Noise of one size along the rays moves grazing points less along the surface's normal.
TEST(Incidence, WhatGrowsCertainWeighsMore) {
  const Errors errors = Compare(0, kScans);
  EXPECT_LT(errors.mean_square, 0.9);
  EXPECT_NEAR(errors.mean_square_over_sigma, 1, 0.3);
}

TEST(Incidence, NothingIsLostWhereItMakesNoDifference) {
  const Errors errors = Compare(1, kScans / 2);
  EXPECT_NEAR(errors.mean_square, 1, 0.02);
}
#endif

// With so few and with so many points that all loops are shared, with the pipe radius known or not,
// looked at while they come or not.
TEST(Incidence, SameBytesForAnyThreadsAndLiveAsReplayed) {
  const Profiles profiles = Scan(7, 3);
  for (const bool radius_known : {true, false}) {
    pipeline::ReconstructionOptions options;
    if (radius_known) options.pipe_radius_mm = 5;
    const auto alone = MeasureProfiles(profiles, options);
    ASSERT_TRUE(alone);
    const auto plain = Measure(Cloud(profiles), options);
    ASSERT_TRUE(plain);
    EXPECT_NE(alone->tube.program, plain->tube.program) << "the poses told nothing";
    host::ThreadWorkers workers(3);
    const auto shared = MeasureProfiles(profiles, options, 50, &workers);
    ASSERT_TRUE(shared);
    ExpectSame(*alone, *shared);
  }
}

// Points without a pose may come between profiles.
TEST(Incidence, PosesOfSomePointsDoNoHarm) {
  const Profiles profiles = Scan(8, 3);
  const hal::ManualClock clock;
  pipeline::Reconstruction live({}, clock);
  for (std::size_t i = 0; i < profiles.size(); ++i) {
    if (i % 2 == 0) {
      live.Add(profiles[i]);
    } else {
      live.Add(Cloud({profiles[i]}));
    }
  }
  const auto found = live.Finish();
  ASSERT_TRUE(found);
  ExpectMeasured(*found, Part(), {.end_mm = 2});
}

}  // namespace
}  // namespace bendloop::tests
