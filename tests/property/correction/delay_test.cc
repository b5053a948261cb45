// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <string>
#include <vector>

#include "pipeline/correction/correction.h"
#include "tests/property/correction/test_bender.h"

// Tubes wait between bender and scanner, so that a correction shows on a tube only when those that
// were bent before it have been measured, too. What the loop must not do then is to answer an error
// again and again that is mended already.
namespace bendloop::pipeline {
namespace {

using support::Rng;

constexpr int kLots = 12;
// Of each lot, after the first correction.
constexpr int kCorrected = 20;

// What a scan's program is taken to be.
enum class Bent {
  kByItsOwn,    // the program that bent the tube, as the ledger knows it
  kByTheNewest  // the one that is active when it is measured
};

// A lot at a bender that springs back further than the cell file says, with `between` tubes on
// their way to the scanner.
class Belt {
 public:
  Belt(std::uint64_t seed, int between, const CorrectionOptions& options, Bent bent)
      : rng_(seed), between_(between), options_(options), bent_(bent) {
    nominal_ = support::RandomProgram(rng_, 1 + static_cast<int>(rng_() % 8));
    sigma_ = support::ConstantSigma(nominal_, 0.03, 0.03, 0.02);
    bender_.springback_deg = 2.0;
    bender_.Detune(rng_, nominal_.rows.size(), 0.5, 1.0, 0.5);
    options_.material = {0.8, 3.0, 1.5};  // true: 2.6, 5.6, 2
    active_ = *InitialProgram(nominal_, options_.material);
  }

  // Bends a tube, and measures the one that reaches the scanner; returns the bent one's errors of
  // angle.
  std::vector<double> Next() {
    const hal::BendProgram tube = bender_.Bend(active_, rng_);
    waiting_.push_back({active_, tube});
    std::vector<double> off_deg;
    for (std::size_t i = 0; i < nominal_.bend_count(); ++i) {
      off_deg.push_back(tube.rows[i].angle_deg - nominal_.rows[i].angle_deg);
    }
    if (waiting_.size() > static_cast<std::size_t>(between_)) Measure();
    return off_deg;
  }

 private:
  struct Tube {
    hal::BendProgram program;
    hal::BendProgram shape;
  };

  void Measure() {
    const Tube tube = waiting_.front();
    waiting_.pop_front();
    CorrectionInput input{nominal_, bent_ == Bent::kByItsOwn ? tube.program : active_,
                          support::Noisy(tube.shape, sigma_, rng_), sigma_, active_};
    input.ahead = 1 + static_cast<unsigned>(between_);
    const auto correction = Correct(input, lot_, options_);
    ASSERT_TRUE(correction) << correction.error().message;
    if (bent_ == Bent::kByItsOwn) {
      ASSERT_FALSE(correction->refused()) << correction->refusals.front();
    }
    if (correction->refused()) return;
    lot_ = correction->next;
    active_ = correction->corrected;
  }

  Rng rng_;
  int between_;
  CorrectionOptions options_;
  Bent bent_;
  support::TestBender bender_;
  hal::BendProgram nominal_;
  hal::BendProgram sigma_;
  hal::BendProgram active_;
  std::deque<Tube> waiting_;
  LotState lot_;
};

double Worst(const std::vector<double>& off_deg) {
  double worst = 0;
  for (const double off : off_deg) worst = std::max(worst, std::abs(off));
  return worst;
}

struct Lots {
  double worst_deg = 0;          // of all corrected tubes
  double worst_to_first = 0;     // a corrected tube's worst angle over its lot's first one
  double scatter_ratio = 0;      // rms of the tubes from the fourth corrected, over the bender's
  double least_first_deg = 1e9;  // the bender is bad enough to test a correction
};

Lots RunLots(int between, const CorrectionOptions& options, Bent bent = Bent::kByItsOwn) {
  Lots lots;
  double squares = 0;
  double bends = 0;
  for (std::uint64_t seed = 1; seed <= kLots; ++seed) {
    Belt belt(seed, between, options, bent);
    const double first_deg = Worst(belt.Next());
    lots.least_first_deg = std::min(lots.least_first_deg, first_deg);
    for (int tube = 0; tube < between; ++tube) belt.Next();
    for (int tube = 1; tube <= kCorrected; ++tube) {
      const std::vector<double> off_deg = belt.Next();
      const double worst_deg = Worst(off_deg);
      lots.worst_deg = std::max(lots.worst_deg, worst_deg);
      lots.worst_to_first = std::max(lots.worst_to_first, worst_deg / first_deg);
      if (tube < 4) continue;
      for (const double off : off_deg) squares += off * off;
      bends += static_cast<double>(off_deg.size());
    }
  }
  lots.scatter_ratio = std::sqrt(squares / bends) / support::TestBender().sigma_angle_deg;
  std::printf("%d between: first %.2f at least, then %.2f degrees at most, scatter ratio %.3f\n",
              between, lots.least_first_deg, lots.worst_deg, lots.scatter_ratio);
  return lots;
}

class Delay : public ::testing::TestWithParam<int> {};

TEST_P(Delay, TheFirstCorrectedTubeIsWithinScatterAndSoAreAllThatFollow) {
  const Lots lots = RunLots(GetParam(), {});
  EXPECT_GT(lots.least_first_deg, 1);
  // Six sigma of what one tube's scatter, learnt from another one's, may come to.
  EXPECT_LT(lots.worst_deg, 6 * std::sqrt(2.0) * support::TestBender().sigma_angle_deg);
  EXPECT_LT(lots.worst_to_first, 1);
  // Of the first twenty tubes; what is steady is a matter of lots_test.cc.
  EXPECT_LT(lots.scatter_ratio, 1.13);
  EXPECT_GT(lots.scatter_ratio, 0.95) << "less than the bender's own scatter cannot be";
}

// A damped first step and small ones after it, cut by the limit while older tubes still come.
TEST_P(Delay, ACautiousCellGetsThereToo) {
  CorrectionOptions options;
  options.gain = {0.8, 0.8, 0.8};
  options.deadband_sigmas = 2;
  options.step_limit = {2, 3, 1};
  options.total_limit = {5, 8, 12};
  const Lots lots = RunLots(GetParam(), options);
  EXPECT_LT(lots.worst_to_first, 1);
  EXPECT_LT(lots.scatter_ratio, 1.3);
}

INSTANTIATE_TEST_SUITE_P(TubesBetween, Delay, ::testing::Values(0, 1, 2, 3, 4, 5));

// The other way round: the error that is mended already comes back with each tube that is still to
// be measured, and grows.
TEST(DelayUnknown, TakingTheNewestProgramForTheTubesOwnAnswersAnErrorTwice) {
  for (int between = 2; between <= 5; ++between) {
    EXPECT_GT(RunLots(between, {}, Bent::kByTheNewest).scatter_ratio, 2) << between;
  }
}

}  // namespace
}  // namespace bendloop::pipeline
