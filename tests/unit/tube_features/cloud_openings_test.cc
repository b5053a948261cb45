// SPDX-License-Identifier: Apache-2.0
// Openings of tubes of which only a cloud is known: slots that are a few samples wide, and what
// lies beside an opening and beside what only looks like one.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "hal/clock.h"
#include "hal/spine.h"
#include "pipeline/features/beside_border.h"
#include "pipeline/features/opening_border.h"
#include "pipeline/reconstruction.h"
#include "tests/support/cut_walls.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::pipeline {
namespace {

using tests::Uniform;

OpeningBorder Slot(double length_mm, double width_mm, double axis_deg) {
  OpeningBorder slot;
  slot.length_mm = length_mm;
  slot.width_mm = width_mm;
  slot.axis_rad = axis_deg * hal::kRadiansPerDegree;
  return slot;
}

// Samples of a plane as far as `half_mm` each way, in such parts as `has` says there are.
template <class Part>
std::vector<Eigen::Vector2d> PlaneOf(double half_mm, double per_mm2, std::mt19937_64& random,
                                     Part has) {
  std::vector<Eigen::Vector2d> samples;
  for (int i = 0; i < static_cast<int>(per_mm2 * 4 * half_mm * half_mm); ++i) {
    const Eigen::Vector2d place(Uniform(random, -half_mm, half_mm),
                                Uniform(random, -half_mm, half_mm));
    if (Uniform(random, 0, 1) < has(place)) samples.push_back(place);
  }
  return samples;
}

auto NotIn(const OpeningBorder& opening) {
  return
      [opening](const Eigen::Vector2d& place) { return opening.DistanceMm(place) < 0 ? 0.0 : 1.0; };
}

TEST(BorderSides, OfALongSlotAreAsLongAsEachOther) {
  std::mt19937_64 random(1);
  const OpeningBorder slot = Slot(50, 6, 20);
  int without = 0;
  for (int i = 0; i < 20; ++i) {
    const auto some = PlaneOf(30, 1.5, random, NotIn(slot));
    const BorderSides sides = SidesOf(slot, some, 0.6, 2.0, 0);
    EXPECT_EQ(sides.all, 24);
    without += sides.all - sides.with_samples;
  }
  // Each has 12 samples by chance.
  EXPECT_EQ(without, 0);
}

// Of two dozen sides some have no sample near them by chance: an opening in a cloud that lacked
// seventy samples was not told. Of what ends where nobody looked a quarter has none.
TEST(BorderSides, FewHaveNoneByChance) {
  std::mt19937_64 random(4);
  constexpr int kClouds = 1000;
  int are_all = 0, edges_are = 0;
  for (int i = 0; i < kClouds; ++i) {
    const OpeningBorder slot = Slot(10, 5, Uniform(random, -90, 90));
    const auto cut = PlaneOf(12, 1.3, random, NotIn(slot));
    are_all += SidesOf(slot, cut, 0.5, 2.3, 0).AreAllButByChance() ? 1 : 0;
    const Eigen::Vector2d axis(std::cos(slot.axis_rad), std::sin(slot.axis_rad));
    const auto edge = PlaneOf(12, 1.3, random, [&](const Eigen::Vector2d& place) {
      return slot.DistanceMm(place) < 0 || place.dot(axis) > 3.5 ? 0.0 : 1.0;
    });
    edges_are += SidesOf(slot, edge, 0.5, 2.3, 0).AreAllButByChance() ? 1 : 0;
  }
  EXPECT_GE(are_all, kClouds * 997 / 1000);
  EXPECT_LE(edges_are, kClouds / 25);
}

TEST(LogOddsOfShadow, TellACutFromAnEdge) {
  std::mt19937_64 random(2);
  for (const double length_mm : {20.0, 40.0, 45.0, 55.0, 60.0}) {
    for (const double axis_deg : {0.0, 10.0, 90.0}) {
      SCOPED_TRACE(testing::Message() << length_mm << " mm long at " << axis_deg << " deg");
      const OpeningBorder slot = Slot(length_mm, 5, axis_deg);
      const double half_mm = 0.5 * length_mm + 8.0;
      for (int i = 0; i < 2; ++i) {
        const auto cut = PlaneOf(half_mm, 12, random, NotIn(slot));
        EXPECT_LT(LogOddsOfShadow(slot, cut, 0.6, 1e3), 0);
        // As where the wall turns away from those who looked.
        const auto edge = PlaneOf(half_mm, 12, random, [&](const Eigen::Vector2d& place) {
          return std::clamp(slot.DistanceMm(place) / 4.0, 0.0, 1.0);
        });
        EXPECT_GT(LogOddsOfShadow(slot, edge, 0.6, 1e3), 0);
        // One end of it another pass has seen, too.
        const Eigen::Vector2d axis(std::cos(slot.axis_rad), std::sin(slot.axis_rad));
        const auto beside = PlaneOf(half_mm, 36, random, [&](const Eigen::Vector2d& place) {
          if (slot.DistanceMm(place) < 0) return 0.0;
          return place.dot(axis) > 0.5 * length_mm + 1.0 ? 1.0 : 0.33;
        });
        EXPECT_LT(LogOddsOfShadow(slot, beside, 0.6, 1e3), 0);
      }
    }
  }
}

// What a drill leaves that leans is longer than wide, and longer still where the wall turns away.
TEST(LogOddsOfShadow, OfAHoleThatLeansAreThoseOfACut) {
  std::mt19937_64 random(3);
  constexpr double kRadiusOfTubeMm = 8;
  for (const double part : {0.6, 0.8, 1.1}) {
    for (int i = 0; i < 12; ++i) {
      SCOPED_TRACE(testing::Message() << part << " pipe radii, " << i);
      OpeningBorder hole;
      hole.length_mm = hole.width_mm = part * kRadiusOfTubeMm;
      const double towards = 0.5 * i, lean = 0.1 * (2 + i % 4);
      hole.lean = lean * Eigen::Vector2d(std::cos(towards), std::sin(towards));
      hole.pipe_radius_mm = kRadiusOfTubeMm;
      const auto wall = PlaneOf(14, 80, random, [&](const Eigen::Vector2d& place) {
        const double side = place.y() / kRadiusOfTubeMm;
        if (hole.DistanceMm(place) < 0 || std::abs(side) > 0.9) return 0.0;
        return 0.4 / std::sqrt(1 - side * side);
      });
      EXPECT_LT(LogOddsOfShadow(hole, wall, 0.3, kRadiusOfTubeMm), -5);
    }
  }
}

TEST(IsLikeItsSurroundings, OnlyBetweenLines) {
  std::mt19937_64 random(3);
  for (int i = 0; i < 20; ++i) {
    SCOPED_TRACE(i);
    const OpeningBorder slot = Slot(12, 2.4, 90);
    const auto scattered = PlaneOf(18, 1.2, random, NotIn(slot));
    EXPECT_FALSE(IsLikeItsSurroundings(slot, scattered, 18, 1e3));
    std::vector<Eigen::Vector2d> lines;
    for (double x = -17; x < 18; x += 2.5) {
      for (double y = -18; y < 18; y += 0.3) {
        lines.emplace_back(x + Uniform(random, -0.1, 0.1), y);
      }
    }
    const OpeningBorder gap = Slot(12, 2.2, 90);
    EXPECT_TRUE(IsLikeItsSurroundings(gap, lines, 18, 1e3));
  }
}

// What is roughly its border may be a fifth too short, or too long.
TEST(OpeningBorder, OfALongSlotIsFoundFromAnyLength) {
  std::mt19937_64 random(4);
  for (int i = 0; i < 24; ++i) {
    SCOPED_TRACE(i);
    const OpeningBorder slot = Slot(24, 4, Uniform(random, -80, 80));
    OpeningBorder about = slot;
    about.length_mm *= Uniform(random, 0.8, 1.2);
    about.width_mm += 0.3;
    const FittedOpening fitted = FitOpening(tests::SampleWall(slot, 2, 0.05, random), about, 0.05);
    EXPECT_NEAR(fitted.border.length_mm, slot.length_mm, 4 * fitted.sigma.length_mm);
    EXPECT_NEAR(fitted.border.width_mm, slot.width_mm, 4 * fitted.sigma.width_mm);
    EXPECT_LT(fitted.sigma.length_mm, 1.0);
  }
}

hal::Tube TubeOfClouds() {
  return {12, {{{130, 0, 60, 36.0}, {90, 90, 45, 36.0}, {120, 0, 0, std::nullopt}}}, {}};
}

// Of a cloud without what an opening of the first straight leaves.
Measurement MeasureCut(const OpeningBorder& opening, double along_mm, double around_deg,
                       const tests::CloudOptions& options, std::mt19937_64& random) {
  const hal::Tube tube = TubeOfClouds();
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const hal::SurfaceFrame frame = hal::FrameAt(segments, along_mm, around_deg);
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3d& point : tests::SyntheticCloud(tube, options, random)) {
    const Eigen::Vector3d from = point - frame.spine_mm;
    const Eigen::Vector2d place(from.dot(frame.tangent), from.dot(frame.sideways()));
    if (from.dot(frame.outward) > 0 && opening.DistanceMm(place) < 0) continue;
    points.push_back(point);
  }
  const auto measurement = Reconstruct(points, {}, hal::ManualClock());
  EXPECT_TRUE(measurement) << (measurement ? "" : measurement.error().message);
  return measurement ? *measurement : Measurement{};
}

// 3.3 to 5.4 times as wide as samples lie apart: too narrow for a void among voids, but none of the
// fifty samples and more that it lacks is missing by chance. A sample here and there parts what is
// empty; it is told whole, or not at all. One was told ten millimetres short, twenty of its sigmas.
TEST(CutCloud, HasSlotsAFewSamplesWide) {
  std::mt19937_64 random(7);
  constexpr int kSlots = 60;
  int found = 0;
  for (int i = 0; i < kSlots; ++i) {
    SCOPED_TRACE(i);
    const OpeningBorder slot =
        Slot(Uniform(random, 24, 36), Uniform(random, 4.5, 5.5), Uniform(random, -30, 30));
    tests::CloudOptions options;
    options.points = static_cast<std::size_t>(Uniform(random, 16'000, 30'000));
    const double along_mm = Uniform(random, 45, 90);
    const Measurement m = MeasureCut(slot, along_mm, Uniform(random, -180, 180), options, random);
    EXPECT_LE(m.features.openings.size(), 1U);
    for (const OpeningFound& opening : m.features.openings) {
      EXPECT_FALSE(opening.opening.is_hole());
      EXPECT_NEAR(opening.opening.width_mm, slot.width_mm, 4 * opening.sigma.width_mm);
      EXPECT_NEAR(opening.opening.length_mm, slot.length_mm, 4 * opening.sigma.length_mm);
      found += 1;
    }
  }
  EXPECT_GE(found, 55);
}

TEST(PlainCloud, HasNoOpenings) {
  std::mt19937_64 random(6);
  for (const double stripes_mm : {0.0, 0.8, 1.6, 2.5}) {
    for (const double tilt : {0.0, 0.3}) {
      if (stripes_mm == 0 && tilt != 0) continue;  // none that could be tilted
      SCOPED_TRACE(testing::Message() << stripes_mm << " mm, tilt " << tilt);
      tests::CloudOptions options;
      options.points = 30'000;
      options.stripes_mm = stripes_mm;
      options.stripe_tilt = tilt;
      const auto m = Reconstruct(tests::SyntheticCloud(TubeOfClouds(), options, random), {},
                                 hal::ManualClock());
      ASSERT_TRUE(m);
      EXPECT_TRUE(m->features.openings.empty());
    }
  }
}

}  // namespace
}  // namespace bendloop::pipeline
