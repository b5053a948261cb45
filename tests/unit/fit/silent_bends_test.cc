// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/silent_bends.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include "hal/spine.h"
#include "pipeline/reconstruction.h"
#include "tests/support/real_tube.h"
#include "tests/unit/fit/three_bends.h"

namespace bendloop::pipeline {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

// `tape_mm`: about the second bend, from well before it to well behind it.
std::vector<std::string> Told(const tests::Form& form, double tape_mm) {
  const hal::Tube tube = ThreeBends();
  const hal::SpineSegment bend = hal::SpineSegments(tube.program, tube.X_WT)[3];
  const Eigen::Vector3d middle_mm = bend.PointAt(0.5 * bend.length_mm);
  const Eigen::Vector3d along = bend.TangentAt(0.5 * bend.length_mm);
  std::mt19937_64 random(3);
  auto points =
      tests::ScanRealTube(tube, form, {.points = 40'000, .noise_mm = 0.005}, random).points_W;
  for (Eigen::Vector3d& point : points) {
    const Eigen::Vector3d from = point - middle_mm;
    const double along_mm = from.dot(along);
    if (from.norm() > 15 || std::abs(along_mm) > 12) continue;
    // Out of the bend's wall, or of the straights' beside it.
    const double turn = std::clamp(along_mm, -0.5 * bend.length_mm, 0.5 * bend.length_mm);
    const Eigen::Vector3d axis_mm = bend.PointAt(0.5 * bend.length_mm + turn);
    point += tape_mm * (point - axis_mm).normalized();
  }
  const auto found = Reconstruct(points, {}, kClock);
  EXPECT_TRUE(found) << found.error().message;
  return found ? found->warnings : std::vector<std::string>{};
}

constexpr const char* kBesideIt = "lie a little beside the tube";

TEST(SilentBends, UnderATapeAreTold) {
  EXPECT_THAT(Told({}, 0.15),
              Contains(HasSubstr(std::string("many of the points of bend 2 ") + kBesideIt)));
}

TEST(SilentBends, AreNoneOfWhatBendersMake) {
  const std::vector<tests::Form> forms = {{}, {.bow = 0.002}, {.easing_r = 0.7}, {.ovality = 0.08}};
  for (const tests::Form& form : forms) {
    const std::vector<std::string> told = Told(form, 0);
    EXPECT_THAT(told, Not(Contains(HasSubstr(kBesideIt))));
    // Nor are an oval bend's points beside the tube, which is as oval.
    EXPECT_THAT(told, Not(Contains(HasSubstr("do not lie on it"))));
  }
}

}  // namespace
}  // namespace bendloop::pipeline
