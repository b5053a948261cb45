// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>

#include "shop_floor.h"

namespace bendloop::test {
namespace {

#ifdef BENDLOOP_FEW_STEPS
constexpr int kSteps = 500;
#else
constexpr int kSteps = 2500;  // four belts: ten thousand in all
#endif

// BENDLOOP_WALK_SEED repeats a walk.
std::uint64_t Seed(std::uint64_t fallback) {
  const char* const given = std::getenv("BENDLOOP_WALK_SEED");
  return given == nullptr ? fallback : std::strtoull(given, nullptr, 10);
}

class TubeWalk : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(TubeWalk, EveryTubeIsCorrectedOnceAtMostAndWithTheProgramThatBentIt) {
  const std::uint64_t between = GetParam();
  const std::uint64_t seed = Seed(20261122 + between);
  SCOPED_TRACE("BENDLOOP_WALK_SEED=" + std::to_string(seed));
  ShopFloor shop(seed, between);
  for (int step = 0; step < kSteps; ++step) {
    SCOPED_TRACE("step " + std::to_string(step));
    shop.Step();
    if (::testing::Test::HasFailure()) return;
  }
  RecordProperty("tubes", static_cast<int>(shop.tubes()));
  RecordProperty("corrected", static_cast<int>(shop.corrected()));
  RecordProperty("held", static_cast<int>(shop.held()));
  // A loop that never acts would be safe, too.
  EXPECT_GT(shop.corrected(), shop.tubes() / 25);
}

INSTANTIATE_TEST_SUITE_P(TubesBetween, TubeWalk, ::testing::Values(0, 1, 2, 5));

}  // namespace
}  // namespace bendloop::test
