// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/grooves.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

struct Wall {
  double crest_mm = 0, pitch_mm = 3, starts = 0, noise_mm = 0.02;  // starts: of a thread
};

std::vector<Eigen::Vector3d> PointsOn(const hal::Tube& tube, const Wall& wall, int count) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> part(0, 1);
  std::normal_distribution<double> noise(0, wall.noise_mm);
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double all_mm = segments.back().from_start_mm + segments.back().length_mm;
  std::vector<Eigen::Vector3d> points;
  while (points.size() < static_cast<std::size_t>(count)) {
    const double along_mm = all_mm * part(random), turn = 2 * std::numbers::pi * part(random);
    for (const hal::SpineSegment& of : segments) {
      const double from_mm = along_mm - of.from_start_mm;
      if (from_mm < 0 || from_mm >= of.length_mm) continue;
      const Eigen::Vector3d up = of.axes().col(2);
      const Eigen::Vector3d across = up.cross(of.TangentAt(from_mm));
      const double wave =
          std::cos(2 * std::numbers::pi * along_mm / wall.pitch_mm + wall.starts * turn);
      const double rho_mm = tube.pipe_radius_mm + wall.crest_mm * wave + noise(random);
      points.push_back(of.PointAt(from_mm) +
                       rho_mm * (std::cos(turn) * across + std::sin(turn) * up));
    }
  }
  return points;
}

std::vector<std::string> Told(const Wall& wall) {
  const auto found = Reconstruct(PointsOn(ThreeBends(), wall, 24'000), {}, kClock);
  EXPECT_TRUE(found) << found.error().message;
  return found ? found->warnings : std::vector<std::string>{};
}

constexpr const char* kSays = "as that of a corrugated hose or a threaded rod does";

TEST(Grooves, OfHosesAndThreadsAreTold) {
  EXPECT_THAT(Told({.crest_mm = 0.2}),
              Contains(HasSubstr("the wall goes up and down along straight 1, 2, 3, 4, by 0.1")));
  EXPECT_THAT(Told({.crest_mm = 0.2, .pitch_mm = 1.5, .starts = 1}), Contains(HasSubstr(kSays)));
  EXPECT_THAT(Told({.crest_mm = 0.2, .pitch_mm = 5, .starts = 2, .noise_mm = 0.1}),
              Contains(HasSubstr(kSays)));
}

TEST(Grooves, AreNotWhatNoiseIs) {
  for (const double noise_mm : {0.02, 0.1, 0.2, 0.3}) {
    EXPECT_THAT(Told({.noise_mm = noise_mm}), Not(Contains(HasSubstr(kSays)))) << noise_mm;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
