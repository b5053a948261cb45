// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/virtual_scan.h"

#include <gtest/gtest.h>

#include <cstring>

#include "tube_fixture.h"

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

VirtualScanOptions Clean() {
  VirtualScanOptions options;
  options.noise_mm = 0;
  options.outlier_fraction = 0;
  options.mixed_pixel_fraction = 0;
  options.quantise = false;
  options.rays = 200;
  options.path.profile_spacing_mm = 4;
  return options;
}

struct Seen {
  Vector3d p_W;
  hal::Pose X_WS;
};

std::vector<Seen> AllPoints(const VirtualScan& scan) {
  std::vector<Seen> points;
  hal::LaserProfile profile(scan.max_points());
  for (std::size_t i = 0; i < scan.profile_count(); ++i) {
    scan.Make(i, profile);
    EXPECT_LE(profile.points.size(), scan.max_points());
    EXPECT_EQ(profile.intensity.size(), profile.points.size());
    for (const auto& point : profile.points) {
      points.push_back({profile.X_WS * Vector3d(point.x_mm, 0, point.z_mm), profile.X_WS});
    }
  }
  return points;
}

TEST(VirtualScan, SeesOnlyTheTrueSurfaceAndOnlyWhatIsInView) {
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    std::mt19937_64 engine(seed);
    const hal::Tube tube = LayOnTable(RandomTube(engine, 1 + static_cast<int>(seed)), seed);
    auto options = Clean();
    options.path.jitter_mm = 1;
    options.path.jitter_deg = 1;
    options.path.views_deg = SpreadViewsDeg(2);
    const VirtualScan scan(tube, options);
    const auto& spine = scan.scene().part().segments();
    const auto points = AllPoints(scan);
    EXPECT_GT(points.size(), 500u) << "seed " << seed;
    std::size_t looked_at = 0;
    for (std::size_t i = 0; i < points.size(); i += 31) {
      const auto& [p, X_WS] = points[i];
      const Vector3d camera = X_WS * Vector3d(0, options.camera_baseline_mm, 0);
      // A random tube may be wound so tightly that the sensor stands in its bore.
      if (NearestFoot(spine, X_WS.position_mm).distance_mm < tube.pipe_radius_mm ||
          NearestFoot(spine, camera).distance_mm < tube.pipe_radius_mm) {
        continue;
      }
      const Foot foot = NearestFoot(spine, p);
      ASSERT_NEAR(foot.distance_mm, tube.pipe_radius_mm, 5e-5) << "seed " << seed;
      const Vector3d normal = (p - foot.point_mm).normalized();
      EXPECT_GT(normal.dot((X_WS.position_mm - p).normalized()), 0.2);
      EXPECT_GT(normal.dot(camera - p), 0);
      // Nothing of the tube between the point and the laser or the camera.
      for (const Vector3d& eye : {X_WS.position_mm, camera}) {
        const Vector3d way = eye - p;
        for (double share = 0.01; share < 1; share += 0.013) {
          ASSERT_GT(NearestFoot(spine, p + share * way).distance_mm, tube.pipe_radius_mm - 1e-4);
        }
      }
      ++looked_at;
    }
    EXPECT_GT(looked_at, 10u);
  }
}

TEST(VirtualScan, OneViewSeesTheNearSideOnly) {
  const hal::Tube tube{10, {{{300, 0, 0, std::nullopt}}}, {}};
  for (const double view_deg : {0.0, 90.0, 200.0}) {
    auto options = Clean();
    options.path.views_deg = {view_deg};
    const double view = view_deg * std::numbers::pi / 180;
    // About +x, from +z.
    const Vector3d side(0, -std::sin(view), std::cos(view));
    const auto points = AllPoints(VirtualScan(tube, options));
    double first = 300;
    double last = 0;
    for (const auto& [p, X_WS] : points) {
      EXPECT_GT(p.dot(side), 0);
      EXPECT_LT((X_WS.position_mm - Vector3d(X_WS.position_mm.x(), 0, 0) - 150 * side).norm(),
                1e-9);
      first = std::min(first, p.x());
      last = std::max(last, p.x());
    }
    // Both ends are reached to a profile's distance, and not passed.
    EXPECT_GE(first, -1e-6);
    EXPECT_LE(first, 4);
    EXPECT_LE(last, 300 + 1e-6);
    EXPECT_GE(last, 296);
  }
}

TEST(VirtualScan, AllAroundSeesEverySide) {
  const hal::Tube tube{10, {{{100, 0, 90, 30.0}, {100, 0, 0, std::nullopt}}}, {}};
  auto options = Clean();
  options.path.views_deg = SpreadViewsDeg(4, true);
  const VirtualScan scan(tube, options);
  std::array<int, 12> sectors{};
  for (const auto& [p, X_WS] : AllPoints(scan)) {
    const Foot foot = NearestFoot(scan.scene().part().segments(), p);
    if (foot.along_mm > 80) continue;  // on the first straight, along +x
    const double angle = std::atan2(p.z(), p.y()) / (2 * std::numbers::pi) + 0.5;
    ++sectors[std::min<std::size_t>(11, static_cast<std::size_t>(12 * angle))];
  }
  for (const int count : sectors) EXPECT_GT(count, 30);
}

// A hairpin standing upright: from above the upper leg hides the lower one.
TEST(VirtualScan, HidesWhatIsBehindTheTubeItself) {
  hal::Tube tube{8, {{{200, 0, 180, 30.0}, {200, 0, 0, std::nullopt}}}, {}};
  tube.X_WT.orientation =
      Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX()));
  const auto points = AllPoints(VirtualScan(tube, Clean()));
  ASSERT_GT(points.size(), 1000u);
  std::size_t low = 0;
  for (const auto& [p, X_WS] : points) {
    // The first leg lies at z = 0, the second at 60; both at x from 0 to 200.
    if (p.z() < 20 && p.x() < 190 && p.x() > 20 && std::abs(p.y()) < 6) ++low;
  }
  EXPECT_EQ(low, 0u);
}

TEST(VirtualScan, ClutterIsSeenAndHides) {
  const hal::Tube tube = LayOnTable(
      hal::Tube{6, {{{120, 0, 60, 25.0}, {80, 90, 45, 25.0}, {60, 0, 0, std::nullopt}}}, {}}, 3);
  auto options = Clean();
  options.clutter = {.table = true, .clamps = 1, .second_tube = false};
  const VirtualScan scan(tube, options);
  const auto& spine = scan.scene().part().segments();
  std::size_t on_tube = 0;
  std::size_t on_table = 0;
  std::size_t on_clamp = 0;
  for (const auto& [p, X_WS] : AllPoints(scan)) {
    const Foot foot = NearestFoot(spine, p);
    if (std::abs(foot.distance_mm - 6) < 1e-3) {
      ++on_tube;
      EXPECT_GT(std::abs(foot.along_mm - 60), 10 - 1e-3);  // hidden in the clamp
    } else if (std::abs(p.z()) < 1e-3) {
      ++on_table;
    } else {
      ++on_clamp;
      EXPECT_LT(std::abs(foot.along_mm - 60), 10 + 1e-3);
      EXPECT_LT(foot.distance_mm, 11 * std::sqrt(2.0) + 1e-3);
    }
  }
  EXPECT_GT(on_tube, 500u);
  EXPECT_GT(on_table, 500u);
  EXPECT_GT(on_clamp, 20u);
  options.clutter = {.table = false, .clamps = 0, .second_tube = true};
  std::size_t on_second = 0;
  for (const auto& [p, X_WS] : AllPoints(VirtualScan(tube, options))) {
    if (NearestFoot(spine, p).distance_mm > 6.1) ++on_second;
  }
  EXPECT_GT(on_second, 100u);
}

TEST(VirtualScan, PutsInTheNoiseThatIsAskedFor) {
  const hal::Tube tube{10, {{{400, 0, 0, std::nullopt}}}, {}};
  auto options = Clean();
  options.noise_mm = 0.05;
  double sum = 0;
  std::size_t count = 0;
  for (const auto& [p, X_WS] : AllPoints(VirtualScan(tube, options))) {
    // On the crest the normal is along the ray.
    if (std::abs(p.y()) > 2) continue;
    const double error = std::hypot(p.y(), p.z()) - 10;
    sum += error * error;
    ++count;
  }
  ASSERT_GT(count, 500u);
  EXPECT_NEAR(std::sqrt(sum / static_cast<double>(count)), 0.05, 0.005);

  options.noise_mm = 0;
  options.outlier_fraction = 0.1;
  std::size_t outside = 0;
  const VirtualScan scan(tube, options);
  const auto points = AllPoints(scan);
  for (const auto& [p, X_WS] : points) outside += std::abs(std::hypot(p.y(), p.z()) - 10) > 0.01;
  EXPECT_NEAR(static_cast<double>(outside), 0.1 * static_cast<double>(scan.profile_count()) * 200,
              400);
}

// Along the normal a displacement along the ray counts with the cosine of the incidence.
TEST(VirtualScan, NoiseGrowsWithTheIncidenceAsAskedFor) {
  const hal::Tube tube{10, {{{400, 0, 0, std::nullopt}}}, {}};
  auto options = Clean();
  options.path.profile_spacing_mm = 1;
  options.noise_mm = 0.02;
  options.noise_growth = 2;
  std::array<double, 2> sum{};  // steep, grazing
  std::array<double, 2> count{};
  for (const auto& [p, X_WS] : AllPoints(VirtualScan(tube, options))) {
    const Vector3d across(0, p.y(), p.z());
    const double cosine = across.normalized().dot((X_WS.position_mm - p).normalized());
    const double error = (across.norm() - 10) * cosine / options.noise_mm;
    sum[cosine < 0.5] += error * error;
    count[cosine < 0.5] += 1;
  }
  for (const int i : {0, 1}) {
    const auto k = static_cast<std::size_t>(i);
    ASSERT_GT(count[k], 500);
    EXPECT_NEAR(std::sqrt(sum[k] / count[k]), 1, 0.06) << i;
  }
}

TEST(VirtualScan, IsTheSameForTheSameSeedInAnyOrder) {
  std::mt19937_64 engine(5);
  const hal::Tube tube = LayOnTable(RandomTube(engine, 3), 5);
  VirtualScanOptions options;
  options.path.profile_spacing_mm = 10;
  options.path.jitter_mm = 0.5;
  options.pose_noise_mm = 0.01;
  options.clutter = {true, 1, true};
  const VirtualScan a(tube, options);
  const VirtualScan b(tube, options);
  options.seed = 2;
  const VirtualScan other(tube, options);
  hal::LaserProfile x;
  hal::LaserProfile y;
  bool differs = false;
  for (std::size_t i = 0; i < a.profile_count(); ++i) {
    const std::size_t index = a.profile_count() - 1 - i;
    a.Make(index, x);
    b.Make(index, y);
    a.Make(0, y);
    b.Make(index, y);
    ASSERT_EQ(x.points.size(), y.points.size());
    EXPECT_EQ(x.X_WS.position_mm, y.X_WS.position_mm);
    ASSERT_TRUE(x.points.empty() ||
                std::memcmp(x.points.data(), y.points.data(), x.points.size() * 8) == 0);
    other.Make(index, y);
    differs |= x.points.size() != y.points.size();
  }
  EXPECT_TRUE(differs);
}

TEST(LayOnTable, TouchesTheTable) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    std::mt19937_64 engine(seed);
    const hal::Tube tube = LayOnTable(RandomTube(engine, static_cast<int>(seed % 5)), seed);
    double lowest = 1e9;
    for (const auto& segment : hal::SpineSegments(tube.program, tube.X_WT)) {
      for (int i = 0; i <= 500; ++i) {
        lowest = std::min(lowest, segment.PointAt(segment.length_mm * i / 500).z());
      }
    }
    EXPECT_NEAR(lowest, tube.pipe_radius_mm, 0.01);
    EXPECT_NEAR(tube.X_WT.orientation.norm(), 1, 1e-12);
  }
}

}  // namespace
}  // namespace bendloop::drivers
