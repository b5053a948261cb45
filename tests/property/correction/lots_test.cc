// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "tests/support/lot_run.h"

// What a master setter would make of a bender, part after part: bendloop_lots (tests/bench) in
// small, and the single troubles by name.
namespace bendloop::support {
namespace {

const LotControllerKind& Ours() { return LotControllers().front(); }

constexpr double kScatter = 0.05;  // mm, degrees

hal::BendProgram Tube() {
  return {
      {{80, 0, 90, 40.0}, {120, 175, 60, 40.0}, {60, -100, 30, 40.0}, {150, 0, 0, std::nullopt}}};
}

// Springback 1.8 degrees + 3.5 %, stretch of 4 %, backlash of 0.3 degrees.
LotBender Shop(std::uint64_t seed) {
  BenderNature nature;
  nature.backlash_deg = 0.3;
  LotBender bender(seed, Tube(), nature);
  bender.vague_ends = 0;
  return bender;
}

// Of all angles, over the parts from `from` on.
double MeanOff(const std::vector<RunPart>& run, std::size_t from) {
  double sum = 0;
  double count = 0;
  for (std::size_t n = from; n < run.size(); ++n) {
    for (std::size_t i = 0; i < 3; ++i) {
      sum += run[n].tube.rows[i].angle_deg - Tube().rows[i].angle_deg;
      count += 1;
    }
  }
  return sum / count;
}

std::size_t OutFrom(const std::vector<RunPart>& run, std::size_t from) {
  return static_cast<std::size_t>(
      std::count_if(run.begin() + static_cast<std::ptrdiff_t>(from), run.end(),
                    [](const RunPart& part) { return !part.in_tolerance; }));
}

TEST(Lots, ACoilThatChangesUnannouncedIsInToleranceAgainWithTheSecondPartAfter) {
  for (std::uint64_t seed = 1; seed <= 15; ++seed) {
    LotBender bender = Shop(seed);
    const auto run = RunLot(bender, Ours(), 30, [](LotBender& b, unsigned n) {
      if (n == 12) b.JumpCoil(0.8);
    });
    EXPECT_FALSE(run[11].in_tolerance) << seed;
    EXPECT_TRUE(run[13].in_tolerance) << seed;
    EXPECT_LE(OutFrom(run, 11), 3u) << seed;
  }
}

TEST(Lots, AJumpOfTenScattersIsInToleranceAgainWithTheSecondPartAfter) {
  for (std::uint64_t seed = 1; seed <= 15; ++seed) {
    LotBender bender = Shop(seed);
    const auto run = RunLot(bender, Ours(), 40, [](LotBender& b, unsigned n) {
      if (n == 20) b.nature().errors[1].angle_deg += 10 * kScatter;
    });
    EXPECT_TRUE(run[21].in_tolerance) << seed;
    EXPECT_LE(OutFrom(run, 19), 3u) << seed;
  }
}

TEST(Lots, DriftLeavesNoBias) {
  for (const double drift_deg : {0.02, -0.02, 0.005}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      LotBender bender = Shop(seed);
      bender.nature().drift_deg = drift_deg;
      const auto run = RunLot(bender, Ours(), 90);
      EXPECT_LT(std::abs(MeanOff(run, 30)), 0.05) << drift_deg << " " << seed;
      EXPECT_LE(OutFrom(run, 10), 1u) << drift_deg << " " << seed;
    }
  }
}

// A tool that wears moves its own bend alone.
TEST(Lots, DriftOfOneBendLeavesNoBiasInIt) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    LotBender bender = Shop(seed);
    bender.nature().drifts[1].angle_deg = 0.02;
    const auto run = RunLot(bender, Ours(), 120);
    double mean = 0;
    for (std::size_t n = 60; n < run.size(); ++n) {
      mean += (run[n].tube.rows[1].angle_deg - Tube().rows[1].angle_deg) / 60;
    }
    EXPECT_LT(std::abs(mean), 0.05) << seed;
  }
}

TEST(Lots, DriftLeavesNoBiasWithTubesOnTheBelt) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    LotBender bender = Shop(seed);
    bender.set_overlap(3);
    bender.nature().drift_deg = 0.02;
    EXPECT_LT(std::abs(MeanOff(RunLot(bender, Ours(), 90), 40)), 0.05) << seed;
  }
}

// Against a twin that bends, scatters and is measured just so, and did not slip.
TEST(Lots, ASlippedTubeMovesNoProgramByMoreThanAScatter) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    LotBender slips = Shop(seed);
    LotBender twin = Shop(seed);
    const auto slipped = RunLot(slips, Ours(), 20, [](LotBender& b, unsigned n) {
      if (n == 5) b.SlipNext(-1.5);
      if (n == 12) b.SlipNext(0.6);
    });
    const auto steady = RunLot(twin, Ours(), 20);
    for (std::size_t n = 0; n < slipped.size(); ++n) {
      if (slipped[n].fate.slipped) continue;
      const auto a = OffInScatters(slips, slipped[n].tube);
      const auto b = OffInScatters(twin, steady[n].tube);
      for (std::size_t j = 0; j < a.size(); ++j) {
        EXPECT_LT(std::abs(a[j] - b[j]), 1) << "seed " << seed << " tube " << n + 1;
      }
    }
  }
}

TEST(Lots, AnEndThatIsHardlySeenHoldsNobodyElse) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    LotBender bender = Shop(seed);
    bender.vague_ends = 0.2;
    EXPECT_LE(OutFrom(RunLot(bender, Ours(), 40), 3), 1u) << seed;
  }
}

TEST(Lots, SteadyScatterIsHardlyMoreThanTheBendersOwn) {
  double squares = 0;
  double count = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    LotBender bender = Shop(seed);
    const auto run = RunLot(bender, Ours(), 200);
    for (std::size_t n = 20; n < run.size(); ++n) {
      for (const double off : OffInScatters(bender, run[n].tube)) {
        squares += off * off;
        count += 1;
      }
    }
  }
  const double ratio = std::sqrt(squares / count);
  std::printf("rms over the bender's own scatter %.3f\n", ratio);
  EXPECT_LT(ratio, 1.1);
  EXPECT_GT(ratio, 0.95) << "less than the bender's own cannot be";
}

// Of forecasts near 90 %, on benders of all tempers.
TEST(Lots, ForecastsComeTrueAsOftenAsTheySay) {
  double promised = 0;
  double kept = 0;
  double count = 0;
  for (std::uint64_t seed = 501; seed <= 530; ++seed) {
    LotBender bender(seed, kBenderTempers[seed % std::size(kBenderTempers)]);
    for (const RunPart& part : RunLot(bender, Ours(), 200)) {
      if (!part.forecast || *part.forecast < 0.87 || *part.forecast > 0.93) continue;
      promised += *part.forecast;
      kept += part.in_tolerance;
      count += 1;
    }
  }
  std::printf("%.0f forecasts of %.3f, %.3f came true\n", count, promised / count, kept / count);
  EXPECT_GT(count, 250);
  EXPECT_NEAR(kept / count, promised / count, 0.02);
}

TEST(Lots, NobodyButTheOracleMakesLessScrap) {
  std::vector<std::size_t> out(LotControllers().size());
  for (std::uint64_t seed = 601; seed <= 618; ++seed) {
    for (std::size_t k = 0; k < out.size(); ++k) {
      LotBender bender(seed, kBenderTempers[seed % std::size(kBenderTempers)]);
      out[k] += OutFrom(RunLot(bender, LotControllers()[k], 100), 0);
    }
  }
  for (std::size_t k = 0; k < out.size(); ++k) {
    std::printf("%s %zu\n", LotControllers()[k].name.c_str(), out[k]);
    if (k > 0 && k + 1 < out.size()) {
      EXPECT_LT(out[0], out[k]);
    }
  }
  EXPECT_LT(static_cast<double>(out.front()), 1.4 * static_cast<double>(out.back()));
}

}  // namespace
}  // namespace bendloop::support
