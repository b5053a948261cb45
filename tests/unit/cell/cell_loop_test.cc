// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/cell_loop.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

#include "config/load.h"
#include "tests/support/scripted_source.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;
using tests::HandClock;
using tests::ScriptedSource;

using Kind = ScriptedSource::Kind;
using Step = ScriptedSource::Step;

class CellLoopTest : public ::testing::Test {
 protected:
  struct Ran {
    std::vector<PartOutcome> parts;
    std::vector<FailedScan> failed;
    CellSnapshot status;
  };

  CellLoopTest() {
    auto part = config::LoadPart(BENDLOOP_SOURCE_DIR "/config/parts/demo.toml");
    EXPECT_TRUE(part);
    cell_.part = *part;
    plan_ = *MakePartPlan(cell_);
    profiles_ = tests::SparseScan({plan_.pipe_radius_mm, plan_.nominal, {}}, 1.5, 60);
  }

  std::vector<Step> Clean() const { return tests::CleanScan(profiles_.size()); }

  Ran Run(std::vector<Step> steps, std::size_t slots = 4096, bool floods = false) {
    HandClock clock;
    ScriptedSource source(profiles_, std::move(steps), clock);
    auto desk =
        BenderDesk::Open(cell_.bender, {.journal = ":memory:", .preload = {}, .commit = {}}, clock);
    EXPECT_TRUE(desk);
    Ran ran;
    StatusBoard board;
    CellPorts ports;
    ports.clock = &clock;
    ports.desk = desk->get();
    ports.board = &board;
    ports.identify = [&] {
      while (floods && !source.over()) std::this_thread::yield();
      return ScanIdentity{"part-0001", "2026-01-01T00:00:00Z", {}};
    };
    ports.part_done = [&](PartOutcome outcome) { ran.parts.push_back(std::move(outcome)); };
    ports.scan_failed = [&](const FailedScan& scan) { ran.failed.push_back(scan); };
    CellLoopOptions options;
    options.scan.max_seconds = 60;
    options.scan.ends_by_coverage = ends_by_coverage_;
    options.scan.starts_by_event = !ends_by_coverage_;
    CellLoop loop(plan_, std::move(ports), options);
    source.silence_over = [&] { return board.Get().failed_scans > 0; };
    ProfileRing ring(slots, source.Info().max_points);
    Acquisition acquisition(source, source.Info(), ring, clock, {});
    EXPECT_TRUE(acquisition.Start());
    loop.Run(acquisition, ring, source.Info());
    acquisition.Stop();
    ran.status = board.Get();
    return ran;
  }

  static void ExpectSameBits(const hal::BendProgram& a, const hal::BendProgram& b) {
    ASSERT_EQ(a.rows.size(), b.rows.size());
    for (std::size_t i = 0; i < a.rows.size(); ++i) {
      EXPECT_EQ(a.rows[i].length_mm, b.rows[i].length_mm) << i;
      EXPECT_EQ(a.rows[i].rotation_deg, b.rows[i].rotation_deg) << i;
      EXPECT_EQ(a.rows[i].angle_deg, b.rows[i].angle_deg) << i;
    }
  }

  config::CellConfig cell_;
  PartPlan plan_;
  std::vector<hal::LaserProfile> profiles_;
  bool ends_by_coverage_ = false;
};

TEST_F(CellLoopTest, LiveAndBatchAgree) {
  const Ran live = Run(Clean());
  ASSERT_EQ(live.parts.size(), 1u);
  const auto& measured = live.parts[0].result.measurement;
  const hal::SteadyClock clock;
  // The same samples in the same order: the same bits.
  pipeline::Reconstruction again(plan_.reconstruction, clock);
  for (const auto& profile : profiles_) again.Add(profile);
  const auto same = again.Finish();
  ASSERT_TRUE(same);
  ExpectSameBits(same->tube.program, measured.tube.program);
  // All at once and without the poses, so that all points weigh the same: another estimate from the
  // same points, which may differ by what both do not know.
  std::vector<Eigen::Vector3d> points;
  for (const auto& profile : profiles_) {
    for (const auto& p : profile.points)
      points.push_back(profile.X_WS * Eigen::Vector3d(p.x_mm, 0, p.z_mm));
  }
  const auto batch = pipeline::Reconstruct(points, plan_.reconstruction, clock);
  ASSERT_TRUE(batch);
  const auto& rows = measured.tube.program.rows;
  ASSERT_EQ(batch->tube.program.rows.size(), rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto& other = batch->tube.program.rows[i];
    const auto& sigma = batch->sigma.rows[i];
    EXPECT_NEAR(other.length_mm, rows[i].length_mm, 3 * sigma.length_mm + 1e-9) << i;
    EXPECT_NEAR(other.rotation_deg, rows[i].rotation_deg, 3 * sigma.rotation_deg + 1e-9) << i;
    EXPECT_NEAR(other.angle_deg, rows[i].angle_deg, 3 * sigma.angle_deg + 1e-9) << i;
  }
}

TEST_F(CellLoopTest, WhatComesTwiceIsCountedAndLeftOut) {
  std::vector<Step> steps = Clean();
  steps.insert(steps.begin() + 40, steps[39]);
  steps.insert(steps.begin() + 200, steps[100]);  // long after
  const Ran ran = Run(steps);
  ASSERT_EQ(ran.parts.size(), 1u);
  EXPECT_EQ(ran.status.repeated_profiles, 1u);
  EXPECT_EQ(ran.status.reordered_profiles, 1u);
  ExpectSameBits(ran.parts[0].result.measurement.tube.program,
                 Run(Clean()).parts.at(0).result.measurement.tube.program);
}

TEST_F(CellLoopTest, SwappedProfilesAreCountedAndMeasured) {
  std::vector<Step> steps = Clean();
  for (std::size_t i = 10; i + 1 < steps.size() - 1; i += 50) std::swap(steps[i], steps[i + 1]);
  const Ran ran = Run(steps);
  ASSERT_EQ(ran.parts.size(), 1u);
  EXPECT_GT(ran.status.reordered_profiles, 10u);
  for (const auto& check : ran.parts[0].result.interlocks->checks) {
    if (check.kind == pipeline::InterlockKind::kLostProfiles) {
      EXPECT_EQ(check.value, 0.0);
    }
  }
  EXPECT_EQ(ran.parts[0].result.measurement.tube.program.bend_count(), 4u);
}

TEST_F(CellLoopTest, ABurstBeyondTheRingIsCountedAndHoldsThePart) {
  const Ran ran = Run(Clean(), 64, true);
  EXPECT_GT(ran.status.dropped_profiles, profiles_.size() - 80);
  EXPECT_EQ(ran.status.profiles + ran.status.dropped_profiles, profiles_.size());
  // Little is left: no measurement, or one that an interlock holds.
  ASSERT_EQ(ran.parts.size() + ran.failed.size(), 1u);
  for (const PartOutcome& part : ran.parts) EXPECT_EQ(part.end, PartEnd::kRefused);
}

TEST_F(CellLoopTest, AScannerThatFallsSilentIsReportedAndGivenUp) {
  std::vector<Step> steps = Clean();
  steps.resize(300);
  steps.push_back({Kind::kSilence, 0});
  std::vector<Step> next = Clean();
  steps.insert(steps.end(), next.begin(), next.end());
  const Ran ran = Run(steps);
  EXPECT_EQ(ran.status.silences, 1u);
  ASSERT_EQ(ran.failed.size(), 1u);
  EXPECT_THAT(ran.failed[0].error.message, ::testing::HasSubstr("said nothing for"));
  EXPECT_EQ(ran.parts.size(), 1u);  // the next scan is measured
}

TEST_F(CellLoopTest, AScanWithoutAnEndEndsWhenTheNominalIsCovered) {
  ends_by_coverage_ = true;
  std::vector<Step> steps = Clean();
  steps.erase(steps.begin());
  steps.pop_back();
  const Ran ran = Run(steps);
  ASSERT_EQ(ran.parts.size(), 1u);
  EXPECT_TRUE(ran.failed.empty());
  EXPECT_EQ(ran.parts[0].result.measurement.tube.program.bend_count(), 4u);
  EXPECT_GT(ran.parts[0].result.measurement.coverage, 0.9);
}

TEST(ProgressLine, SaysWhatIsSeenAndWhatIsMissing) {
  pipeline::LiveView view;
  EXPECT_EQ(ProgressLine(view, 620), "no bend seen; 620 mm of 620 still missing");
  view.covered_mm = 440;
  view.program.rows = {{100, 0, 90, 20}, {50, 30, 30, 20}, {60, 0, 41.2, 20}, {10, 0, 0, {}}};
  view.sigma = view.program;
  view.sigma.rows[2].angle_deg = 0.1;
  EXPECT_EQ(ProgressLine(view, 620),
            "bend 3 seen, 41.2 +- 0.1 degree; 180 mm of 620 still missing");
}

}  // namespace
}  // namespace bendloop::host
