// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <deque>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "config/load.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/part_run.h"
#include "pipeline/correction/material.h"
#include "tests/support/faulty_link.h"
#include "tests/support/memory_bender.h"
#include "tests/support/synthetic_tube.h"

namespace bendloop::test {

// A cell in simulated time around the real desk, ledger, commit protocol and decision: a bender
// whose truth is known, a belt of tubes, a setter who does as he likes, processes that die. What it
// asserts is what the loop may never do; what was done is counted.
class ShopFloor {
 public:
  ShopFloor(std::uint64_t seed, std::uint64_t between)
      : random_(seed), between_(between), bender_(PlainMap(), {}) {
    auto part = config::LoadPart(BENDLOOP_SOURCE_DIR "/config/parts/demo.toml");
    EXPECT_TRUE(part);
    config::CellConfig cell;
    cell.part = *part;
    plan_ = *host::MakePartPlan(cell);
    // Each part is followed, so that there is something to be done wrong.
    plan_.correction.deadband_sigmas = plan_.correction.deadband_scatter = 0;
    plan_.correction.step_limit = {50, 90, 90};
    plan_.correction.total_limit = {100, 180, 180};
    plan_.commit.reply_timeout = std::chrono::milliseconds(500);
    LoadAtThePanel(plan_.part_number);
    clock_.Advance(std::chrono::hours(1));
    StartDaemon();
  }
  ~ShopFloor() {
    desk_.reset();
    std::filesystem::remove_all(folder_);
  }

  // What happens next, and some time goes by.
  void Step() {
    const int what = Uniform(0, 99);
    if (what < 30) {
      Bend();
    } else if (what < 55) {
      ScanNext();
    } else if (what < 63) {
      ScanAgain();
    } else if (what < 67) {
      DropUnscanned();
    } else if (what < 70) {
      EditAtThePanel();
    } else if (what < 72) {
      LoadOtherPart();
    } else if (what < 75) {
      RestartDaemon();
    } else if (what < 77) {
      bender_.Reboot();
    } else if (what < 79) {
      LoseLink();
    } else if (what < 83) {
      DieAtACall();
    } else if (what < 87) {
      LoseAnAnswer();
    }
    Pass(Uniform(1, 12));
  }

  std::size_t tubes() const { return tubes_.size(); }
  std::size_t corrected() const { return corrected_; }
  std::size_t held() const { return held_; }

 private:
  struct Tube {
    hal::ProgramBlock program;
    bool scanned = false;
    bool gone = false;
    int corrections = 0;
  };
  // Hands the desk a link of which it may dispose.
  class Borrowed final : public hal::BenderLink {
   public:
    explicit Borrowed(hal::BenderLink& link) : link_(link) {}
    hal::Result<hal::BenderInfo> Connect() override { return link_.Connect(); }
    hal::Result<hal::BenderState> ReadState() override { return link_.ReadState(); }
    hal::Result<hal::ProgramBlock> ReadActive() override { return link_.ReadActive(); }
    hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
      return link_.Encode(block);
    }
    hal::Result<void> Stage(const hal::ProgramBlock& block) override { return link_.Stage(block); }
    hal::Result<hal::ProgramBlock> ReadStaged() override { return link_.ReadStaged(); }
    hal::Result<void> Commit(std::uint32_t sequence) override { return link_.Commit(sequence); }

   private:
    hal::BenderLink& link_;
  };

  int Uniform(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double Gauss() { return std::normal_distribution<double>()(random_); }

  host::Moment Now() const {
    return {clock_.Now().count(), clock_.Now().count() / 1'000'000 + 1'700'000'000'000};
  }

  // A desk lives with one link: each fault to come has a link and a daemon of its own.
  void OpenDesk(Fault fault) {
    desk_.reset();
    host::BenderDesk::Options options;
    options.journal = folder_ / "journal.db";
    options.commit = plan_.commit;
    options.ledger.parts_between = between_;
    options.moment = [this] { return Now(); };
    auto desk =
        host::BenderDesk::Open(std::make_unique<Borrowed>(Link(std::move(fault))), options, clock_);
    ASSERT_TRUE(desk) << desk.error().message;
    desk_ = std::move(*desk);
    waiting_.reset();
  }
  void StartDaemon() {
    ASSERT_NO_FATAL_FAILURE(OpenDesk({}));
    Guarded([&] {
      (void)desk_->Resume();
      (void)desk_->Look();
    });
  }
  void RestartDaemon() {
    desk_.reset();
    clock_.Advance(std::chrono::milliseconds(Uniform(100, 20'000)));
    StartDaemon();
  }

  FaultyLink& Link(Fault fault) {
    links_.push_back(std::make_unique<FaultyLink>(bender_, std::move(fault)));
    return *links_.back();
  }
  void DieAtACall() {
    OpenDesk({.at_call = Uniform(0, 60),
              .when = Uniform(0, 1) == 0 ? FaultWhen::kBefore : FaultWhen::kAfter,
              .crash = true});
    Look();
  }
  void LoseAnAnswer() {
    OpenDesk({.at_call = Uniform(0, 60),
              .when = Uniform(0, 1) == 0 ? FaultWhen::kBefore : FaultWhen::kAfter,
              .down_for = Uniform(0, 3)});
    Look();
  }
  // Nothing is seen of the bender, which goes on.
  void LoseLink() {
    clock_.Advance(std::chrono::seconds(Uniform(1, 8)));
    if (Uniform(0, 1) == 0) Finish();
    clock_.Advance(std::chrono::seconds(Uniform(1, 8)));
  }

  // A death of the daemon in the middle of anything is followed by a new one.
  template <class Work>
  void Guarded(Work work) {
    try {
      work();
    } catch (const Crash&) {
      StartDaemon();
    }
  }
  void Look() {
    const hal::ProgramBlock before = bender_.Active();
    Guarded([&] { (void)desk_->Look(); });
    ExpectUnchangedOrOurs(before);
  }
  // Looks every quarter of a second; a running cycle may end at any of them.
  void Pass(int quarters) {
    for (int i = 0; i < quarters; ++i) {
      clock_.Advance(std::chrono::milliseconds(250));
      if (bending_ && Uniform(0, 3) == 0) Finish();
      Look();
      TryAgain();
    }
  }

  void Bend() {
    if (bending_) return;
    bending_ = bender_.Active();
    bender_.SetMode(hal::BenderMode::kBending);
    if (Uniform(0, 3) == 0) Finish();
  }
  void Finish() {
    if (!bending_) return;
    bender_.CountTube();
    bender_.SetMode(hal::BenderMode::kIdle);
    Tube tube;
    tube.program = *bending_;
    tubes_.push_back(tube);
    bending_.reset();
  }

  void LoadAtThePanel(std::uint32_t part) {
    auto program = pipeline::InitialProgram(plan_.nominal, plan_.correction.material);
    ASSERT_TRUE(program);
    bender_.LoadActive({part, 0, *program, 0});
  }
  // In the middle of a cycle, too.
  void EditAtThePanel() {
    hal::ProgramBlock edited = bender_.Active();
    edited.program.rows[1].angle_deg += 6 * Gauss();
    if (Uniform(0, 1) == 0) edited.sequence = 0;  // a panel may leave the number as it is
    bender_.LoadActive(edited);
  }
  void LoadOtherPart() {
    LoadAtThePanel(bender_.Active().part_number == plan_.part_number ? plan_.part_number + 1
                                                                     : plan_.part_number);
  }

  void DropUnscanned() {
    for (Tube& tube : tubes_) {
      if (tube.scanned || tube.gone) continue;
      tube.gone = true;
      return;
    }
  }
  // The tube that lies `between_` before the newest, if it is still there.
  void ScanNext() {
    if (tubes_.size() < between_ + 1) return;
    const std::size_t at = tubes_.size() - 1 - between_;
    if (tubes_[at].gone || tubes_[at].scanned) return;
    if (Uniform(0, 9) == 0) return;  // the scanner is restarted in the middle: nothing to decide
    last_scanned_ = at;
    bent_at_scan_ = tubes_.size();
    Scan(at);
  }
  void ScanAgain() {
    // Before another tube has moved up: beyond that nobody could tell without a name on the tube.
    if (last_scanned_ && bent_at_scan_ == tubes_.size()) Scan(*last_scanned_);
  }

  void Scan(std::size_t at) {
    tubes_[at].scanned = true;
    host::MeasuredPart part;
    char name[32];
    std::snprintf(name, sizeof name, "part-%04zu", ++sessions_);
    part.identity = {name, "2026-01-01T00:00:00.000Z", ""};
    tube_of_[name] = at;
    part.scan.profiles = 1000;
    part.scan.began_ns = Now().boot_ns;
    Look();
    Pass(Uniform(0, 8));  // the next tube may be bent meanwhile
    hal::Tube tube{plan_.pipe_radius_mm,
                   pipeline::PredictBent(tubes_[at].program.program, plan_.correction.material),
                   {}};
    for (hal::BendRow& row : tube.program.rows) {
      if (row.angle_deg > 0) row.angle_deg += -2 + bias_deg_ + 0.05 * Gauss();
    }
    bias_deg_ += 0.1 * Gauss();  // there is always something to correct
    support::Rng rng(sessions_);
    part.measurement = support::MeasurementOf(tube, rng, 40);
    part.scan.ended = Now();
    part.lot = lot_;
    part.may_wait = true;
    waiting_.reset();
    Decide(part);
  }

  void TryAgain() {
    if (!waiting_) return;
    const host::MeasuredPart part = *waiting_;
    waiting_.reset();
    Decide(part);
  }

  void Decide(const host::MeasuredPart& part) {
    const hal::ProgramBlock before = bender_.Active();
    const std::size_t at = tube_of_.at(part.identity.session);
    deciding_ = at;
    Guarded([&] {
      const host::PartOutcome outcome = host::DecidePart(plan_, part, *desk_);
      if (outcome.next) {
        // What the lot learns from is what bent the tube.
        EXPECT_EQ(outcome.context.bent_with, tubes_[at].program);
        lot_ = outcome.next;
      }
      if (outcome.end == host::PartEnd::kWaiting) waiting_ = part;
      if (outcome.end == host::PartEnd::kRefused) ++held_;
    });
    ExpectUnchangedOrOurs(before);
    deciding_.reset();
  }

  // The bender's program changes here by our commits alone.
  void ExpectUnchangedOrOurs(const hal::ProgramBlock& before) {
    const hal::ProgramBlock now = bender_.Active();
    if (now == before) return;
    ASSERT_TRUE(deciding_) << "a program became active that nobody was deciding on";
    EXPECT_EQ(before.part_number, plan_.part_number) << "another part's program was overwritten";
    EXPECT_EQ(now.part_number, plan_.part_number);
    EXPECT_EQ(tubes_[*deciding_].program.part_number, plan_.part_number);
    EXPECT_EQ(++tubes_[*deciding_].corrections, 1) << "a tube was corrected twice";
    ++corrected_;
  }

  std::mt19937_64 random_;
  const std::uint64_t between_;
  hal::ManualClock clock_;
  host::PartPlan plan_;
  MemoryBender bender_;
  std::vector<std::unique_ptr<FaultyLink>> links_;  // outlive the desk
  std::filesystem::path folder_ = [] {
    // In memory where there is such a place: each step is flushed to the disk.
    std::error_code none;
    const std::filesystem::path shm = "/dev/shm";
    const auto base =
        std::filesystem::is_directory(shm, none) ? shm : std::filesystem::temp_directory_path();
    std::string name = (base / "bendloop-XXXXXX").string();
    return std::filesystem::path(mkdtemp(name.data()));
  }();
  std::unique_ptr<host::BenderDesk> desk_;
  std::vector<Tube> tubes_;
  std::optional<hal::ProgramBlock> bending_;
  std::optional<pipeline::LotState> lot_;
  std::optional<host::MeasuredPart> waiting_;
  std::map<std::string, std::size_t> tube_of_;
  std::optional<std::size_t> last_scanned_;
  std::optional<std::size_t> deciding_;
  std::size_t bent_at_scan_ = 0;
  std::size_t sessions_ = 0;
  std::size_t corrected_ = 0;
  std::size_t held_ = 0;
  double bias_deg_ = 0;
};

}  // namespace bendloop::test
