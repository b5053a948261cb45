// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/section_rise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/reconstruction.h"
#include "tests/support/error_sigmas.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

// Errors over sigmas of tubes whose bends' sections rise over a length of their own.
struct RiseErrors {
  tests::ErrorSigmas lengths, radii, angles;

  // `easing_r`: of the curvature.
  void Add(unsigned seed, double easing_r) {
    std::mt19937_64 random(seed);
    const auto uniform = [&random](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    tests::Form form{.easing_r = easing_r, .ovality = uniform(0.005, 0.05)};
    form.sunk = seed % 2 == 0 ? uniform(0.005, 0.02) : 0.0;
    form.section_rise_r = uniform(0.3, 0.8);
    const tests::RealScan scan{.points = 60'000, .noise_mm = 0.02};
    const auto cloud = tests::ScanRealTube(ThreeBends(), form, scan, random);
    const auto found = Reconstruct(cloud.points_W, {}, kClock);
    ASSERT_TRUE(found) << found.error().message;
    const auto& rows = found->tube.program.rows;
    ASSERT_EQ(rows.size(), 4U);
    const bool reversed = std::abs(rows[0].angle_deg - 60) > 5;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t k = reversed ? 2 - i : i;
      const auto& was = cloud.truth.program.rows[i];
      const auto& sigma = found->sigma.rows[k];
      radii.Add(*rows[k].bend_radius_mm - *was.bend_radius_mm, *sigma.bend_radius_mm);
      angles.Add(rows[k].angle_deg - was.angle_deg, sigma.angle_deg);
      if (i == 0) continue;
      const std::size_t row = reversed ? 3 - i : i;
      lengths.Add(rows[row].length_mm - was.length_mm, found->sigma.rows[row].length_mm);
    }
    for (const auto& easing : found->bend_easings) {
      EXPECT_NEAR(easing.length_mm, std::sqrt(12.0) * 5 * easing_r,
                  4 * easing.length_sigma_mm + 0.3)
          << seed;
    }
  }
};

constexpr double kHalfMm = 3.0, kBeforeMm = 0.7;

// A tube whose bends have such a section.
struct RisingBend {
  hal::Tube tube = ThreeBends();
  EasedSpine spine;
  std::vector<Flattening> flattening{
      3, Flattening{.constant = 0.05, .collapse = 0.01, .plateau = 0.02}};

  explicit RisingBend(const Easing& easing = {{0.01, 0.01, 0.01}}) {
    for (Flattening& of_bend : flattening) of_bend.rise = {kHalfMm, kBeforeMm};
    spine = SpineOf(tube.program, tube.X_WT, easing);
  }
  std::vector<SegmentFrame> Frames() const { return SegmentFrames(spine, 100.0, flattening); }
  // How far the wall lies inside the round one on a side of the first bend.
  double InsideMm(double along_mm, double from_outer_rad) const {
    const std::size_t k = hal::SegmentAt(spine.segments, along_mm);
    const hal::SpineSegment& segment = spine.segments[k];
    const double on_mm = along_mm - segment.from_start_mm;
    const std::size_t behind = spine.pieces;  // the first bend's last piece
    const hal::SpineSegment& bend = spine.segments[std::clamp(k, std::size_t{1}, behind)];
    const Eigen::Vector3d outer = -bend.normal.cross(segment.TangentAt(on_mm));
    const Eigen::Vector3d point =
        segment.PointAt(on_mm) +
        5.0 * (std::cos(from_outer_rad) * outer + std::sin(from_outer_rad) * bend.normal);
    PointLanes lanes;
    lanes.x[0] = point.x(), lanes.y[0] = point.y(), lanes.z[0] = point.z();
    LocalLanes local;
    std::array<double, kBatch> inside_mm{};
    const SegmentFrame frame = Frames()[k];
    ToSegment(frame, lanes, 1, local);
    if (frame.is_flattened()) FlattenedBy(frame, 5.0, local, inside_mm);
    return inside_mm[0];
  }
};

TEST(SectionRise, GoesOnFromStraightToStraight) {
  const double arc_mm = 60.0 * hal::kRadiansPerDegree * 15.0, whole_mm = 5.0 * (0.5 * 0.05 + 0.03);
  for (const Easing& easing : {Easing{}, Easing{{0.01, 0.01, 0.01}}, Easing{{1.0, 1.0, 1.0}}}) {
    const RisingBend bend(easing);
    const double eased_mm =  // the spine is so much shorter
        easing.empty()
            ? 0.0
            : SpineOf(bend.tube.program, bend.tube.X_WT, {}).length_mm() - bend.spine.length_mm();
    const double risen_mm = 45.0 - kBeforeMm - eased_mm / 6.0;
    const double fallen_mm = risen_mm + 2.0 * kBeforeMm + arc_mm;
    for (const double towards : {1.0, -1.0}) {
      const double half_mm = towards > 0 ? risen_mm : fallen_mm;
      EXPECT_EQ(bend.InsideMm(half_mm - towards * (kHalfMm + 0.2), 0.0), 0.0);
      EXPECT_NEAR(bend.InsideMm(half_mm, 0.0), 0.5 * whole_mm, 0.02 * whole_mm);
      EXPECT_NEAR(bend.InsideMm(half_mm + towards * (kHalfMm + 0.2), 0.0), whole_mm, 1e-5);
    }
    for (const double psi : {0.0, 0.6, 1.5, 3.0}) {
      double last_mm = bend.InsideMm(38.0, psi);
      for (double at_mm = 38.0; at_mm < 70.0; at_mm += 0.01) {
        const double here_mm = bend.InsideMm(at_mm, psi);
        EXPECT_NEAR(here_mm, last_mm, 0.8 / kHalfMm * 0.01 * whole_mm) << at_mm << ", " << psi;
        last_mm = here_mm;
      }
    }
  }
}

// The sums over a line's points tell what its section's numbers do to the distances.
TEST(SectionRise, SumsOfALineHaveItsDerivatives) {
  RisingBend bend;
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> along(0.0, 45.0), around(-3.1, 3.1), off(-0.1, 0.1);
  SegmentPoints points;
  points.MakeRoom(500);
  for (Eigen::Index i = 0; i < 500; ++i) {
    const double phi = around(random), rho_mm = 5.0 + off(random);
    points.x[i] = along(random);
    points.y[i] = rho_mm * std::cos(phi);
    points.z[i] = rho_mm * std::sin(phi);
    points.distance[i] = 0.0;
    ++points.size;
  }
  const auto half_squares = [&] {
    const CondensedSum sum = SumOfRows(points, bend.Frames().front(), 5.0, 1.0);
    return 0.5 * sum(kLocalState, kLocalState);
  };
  const CondensedSum sum = SumOfRows(points, bend.Frames().front(), 5.0, 1.0);
  constexpr double kStep = 1e-5;
  double& constant = bend.flattening[0].constant;
  constant += kStep;
  const double more = half_squares();
  constant -= 2.0 * kStep;
  const double less = half_squares();
  constant += kStep;
  EXPECT_NEAR((more - less) / (2.0 * kStep), sum(kFlatteningState + 2, kLocalState), 1e-6);
  EXPECT_GT(std::abs(sum(kFlatteningState + 2, kLocalState)), 0.1);
  // Of what sinks in, both widths alike.
  Flattening& first = bend.flattening[0];
  first.collapse += kStep, first.plateau += kStep;
  const double deeper = half_squares();
  first.collapse -= 2.0 * kStep, first.plateau -= 2.0 * kStep;
  EXPECT_NEAR((deeper - half_squares()) / (4.0 * kStep), sum(kFlatteningState + 3, kLocalState),
              1e-6);
}

void ExpectAsSureAsItSays(unsigned first_seed, double easing_r) {
  RiseErrors errors;
  for (unsigned seed = first_seed; seed < first_seed + 6; ++seed) {
    SCOPED_TRACE(seed);
    errors.Add(seed, easing_r);
  }
  EXPECT_LT(errors.lengths.rms(), 1.4);
  EXPECT_LT(errors.radii.rms(), 1.4);
  EXPECT_LT(errors.angles.rms(), 1.4);
}

// A mandrel lets bends be oval before they begin.
TEST(SectionRise, OvalBeforeItsBendsIsNoEasing) { ExpectAsSureAsItSays(1, 0.0); }

TEST(SectionRise, EasingIsWhatTheSpineShows) { ExpectAsSureAsItSays(21, 0.4); }

}  // namespace
}  // namespace bendloop::pipeline
