// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <list>
#include <memory>
#include <utility>

#include "config/load.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/part_run.h"
#include "pipeline/correction/material.h"
#include "tests/support/hand_clock.h"
#include "tests/support/memory_bender.h"
#include "tests/support/synthetic_tube.h"

namespace bendloop::test {

// A cell whose bender has bent a tube, which came out two degrees short in each bend and is
// measured: its decision is to come.
class BentTube {
 public:
  BentTube() {
    config::CellConfig cell;
    cell.part = config::LoadPart(BENDLOOP_SOURCE_DIR "/config/parts/demo.toml").value();
    plan = std::make_shared<host::PartPlan>(host::MakePartPlan(cell).value());
    auto link = std::make_unique<MemoryBender>(PlainMap(), hal::ProgramBlock{});
    bender = link.get();
    bender->LoadActive({plan->part_number, 0,
                        pipeline::InitialProgram(plan->nominal, plan->correction.material).value(),
                        0});
    before = bender->Active();
    clock.Advance(std::chrono::hours(1));
    host::BenderDesk::Options options{.journal = ":memory:", .preload = {}, .commit = plan->commit};
    options.moment = [this] { return Now(); };
    desk = std::move(host::BenderDesk::Open(std::move(link), options, clock).value());
    Look();
    Look();  // it has not just been loaded
    Bend();
    Measure();
  }

  host::Moment Now() const {
    return {clock.Now().count(), clock.Now().count() / 1'000'000 + 1'700'000'000'000};
  }
  void Look() {
    clock.Advance(std::chrono::milliseconds(250));
    EXPECT_TRUE(desk->Look().facts);
  }
  bool is_corrected() const { return bender->Active() != before; }
  std::list<host::SettledCommit> Settled() {
    std::list<host::SettledCommit> settled;
    desk->TakeSettled(settled);
    return settled;
  }

  tests::HandClock clock;
  std::shared_ptr<host::PartPlan> plan;
  std::unique_ptr<host::BenderDesk> desk;
  MemoryBender* bender = nullptr;
  hal::ProgramBlock before;  // that bent it
  host::MeasuredPart part;

 private:
  void Bend() {
    bender->SetMode(hal::BenderMode::kBending);
    Look();
    bender->CountTube();
    bender->SetMode(hal::BenderMode::kIdle);
    Look();
  }
  void Measure() {
    part.identity = {"part-0001", "2026-01-01T00:00:00.000Z", ""};
    part.scan.profiles = 1000;
    part.scan.began_ns = Now().boot_ns;
    hal::Tube tube{
        plan->pipe_radius_mm, pipeline::PredictBent(before.program, plan->correction.material), {}};
    for (hal::BendRow& row : tube.program.rows) {
      if (row.angle_deg > 0) row.angle_deg -= 2;
    }
    support::Rng rng(1);
    part.measurement = support::MeasurementOf(tube, rng, 40);
    part.scan.ended = Now();
    part.may_wait = true;
    Look();
  }
};

}  // namespace bendloop::test
