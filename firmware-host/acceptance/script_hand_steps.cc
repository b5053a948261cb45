// SPDX-License-Identifier: Apache-2.0
//
// What needs somebody at the machine.
#include <optional>
#include <utility>

#include "firmware-host/acceptance/scripts.h"
#include "firmware-host/acceptance/state_words.h"

namespace bendloop::host {
namespace {

constexpr const char* kNobody = "nobody was there to do it";
// A PLC needs its time to start, and a machine to be made ready.
constexpr std::chrono::minutes kComeBack{5};
constexpr std::chrono::milliseconds kLookAgain{100};

// Waits until it is idle; whatever it does until then, silence included.
bool AwaitIdle(Plc& plc) {
  const auto end = plc.clock().Now() + kComeBack;
  while (plc.clock().Now() < end) {
    const auto state = plc.Answers() ? plc.State() : std::nullopt;
    plc.TakeTrouble();
    if (state && state->mode == plc.map().mode_idle) return true;
    plc.clock().SleepFor(kLookAgain);
  }
  return false;
}

void WatchBeats(Bench& bench) {
  Plc& plc = bench.plc();
  if (!plc.has_heartbeat()) return;
  plc.WatchHeartbeat();
  while (plc.beats() == 0 && plc.longest_standstill() <= kSlowestBeat && plc.State()) {
    plc.clock().SleepFor(bench.options().poll_period);
  }
  bench.Expect(Rule::kHeartbeat, plc.beats() > 0,
               "the heartbeat stands still while it is not idle");
}

void CommitWhileBusy(Bench& bench) {
  Plc& plc = bench.plc();
  const auto before = plc.State();
  if (!before) return;
  if (!bench.Expect(Rule::kMode, before->mode != plc.map().mode_idle,
                    "mode is idle while no program may be exchanged")) {
    return;
  }
  ExpectKnownMode(bench, *before);
  const RegisterProgram program = bench.Fresh();
  if (!bench.StageAndCompare(program)) return;
  const auto still = plc.State();
  if (still && still->mode == plc.map().mode_idle) {
    return bench.LeaveOut("the machine was idle again too early");
  }
  bench.ExpectRejected(Rule::kIdle, program.sequence, program);
  WatchBeats(bench);
}

void PlayBusy(Bench& bench, HandSteps& hands) {
  bench.Explain(Rule::kIdle, kNobody);
  bench.Explain(Rule::kMode, kNobody);
  for (const auto& [step, name] : {std::pair(HandStep::kStartCycle, "commit while a cycle runs"),
                                   std::pair(HandStep::kOpenGuard, "commit while it is not ready"),
                                   std::pair(HandStep::kFault, "commit while it is in fault")}) {
    bench.Run(name, [&, step = step] {
      if (!hands.Do(step)) return bench.LeaveOut(kNobody);
      CommitWhileBusy(bench);
      hands.Do(HandStep::kMakeIdle);
      const bool idle = bench.plc().trouble() || AwaitIdle(bench.plc());
      bench.Expect(Rule::kMode, idle, "mode did not become idle again");
    });
  }
}

void PlayPowerCycle(Bench& bench, HandSteps& hands) {
  bench.Explain(Rule::kPowerLoss, kNobody);
  bench.Run("the active program outlives a power cycle", [&] {
    Plc& plc = bench.plc();
    const RegisterProgram staged = bench.Fresh();
    if (!bench.StageAndCompare(staged)) return;
    if (!hands.Do(HandStep::kPowerCycle)) return bench.LeaveOut(kNobody);
    if (!bench.Expect(Rule::kPowerLoss, AwaitIdle(plc), "the PLC did not come back")) return;
    const auto active = plc.Active();
    if (!active) return;
    if (!bench.Expect(
            Rule::kPowerLoss, *active == bench.active(),
            "after the power cycle active " + Difference(plc.map(), *active, bench.active()))) {
      bench.Adopt(*active);
    }
    plc.WatchHeartbeat();
  });
  bench.Run("commit a good program after the power cycle", [&] {
    if (bench.is_broken(Rule::kPowerLoss)) return bench.LeaveOut("it holds another program");
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
}

void PlayPanel(Bench& bench, HandSteps& hands) {
  bench.Explain(Rule::kPanel, kNobody);
  bench.Run("the crc after an edit at the panel", [&] {
    Plc& plc = bench.plc();
    if (!hands.Do(HandStep::kEditAtPanel)) return bench.LeaveOut(kNobody);
    const auto active = plc.Active();
    if (!active) return;
    const bool edited = active->words != bench.active().words;
    const RegisterProgram before = bench.active();
    bench.Adopt(*active);
    if (!edited) return bench.LeaveOut("no value of the active program was changed");
    const bool keyed_in = active->sequence == 0 && active->crc == 0;
    bench.Expect(Rule::kPanel, keyed_in || plc.form().Crc(*active) == active->crc,
                 "the crc is not that of the edited rows, nor are sequence and crc 0");
    bench.Expect(Rule::kPanel, active->part_number == before.part_number,
                 "the edit changed the part number");
  });
  bench.Run("commit a good program after the edit", [&] {
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
}

void PlayStop(Bench& bench, HandSteps& hands) {
  bench.Run("the heartbeat stands still while the PLC's program is stopped", [&] {
    Plc& plc = bench.plc();
    if (!plc.has_heartbeat()) return bench.LeaveOut("the register map has no heartbeat");
    if (!hands.Do(HandStep::kStopProgram)) return bench.LeaveOut(kNobody);
    plc.WatchHeartbeat();
    const auto end = plc.clock().Now() + bench.options().standstill;
    while (plc.clock().Now() < end && plc.Answers() && plc.State()) {
      plc.clock().SleepFor(kLookAgain);
    }
    plc.TakeTrouble();  // a PLC that says nothing at all is seen to be stopped, too
    bench.Expect(Rule::kHeartbeat, plc.beats() == 0,
                 "it goes on counting: it is not the program that counts");
    hands.Do(HandStep::kStartProgram);
    bench.Expect(Rule::kHeartbeat, AwaitIdle(plc), "the PLC did not come back");
    plc.WatchHeartbeat();
  });
}

}  // namespace

const char* Word(HandStep step) {
  switch (step) {
    case HandStep::kStartCycle:
      return "cycle";
    case HandStep::kOpenGuard:
      return "guard";
    case HandStep::kFault:
      return "fault";
    case HandStep::kMakeIdle:
      return "idle";
    case HandStep::kPowerCycle:
      return "power-cycle";
    case HandStep::kEditAtPanel:
      return "edit";
    case HandStep::kStopProgram:
      return "stop";
    case HandStep::kStartProgram:
      return "start";
  }
  return "";
}

void PlayHandSteps(Bench& bench, HandSteps& hands) {
  PlayBusy(bench, hands);
  PlayPanel(bench, hands);
  PlayPowerCycle(bench, hands);
  PlayStop(bench, hands);
}

}  // namespace bendloop::host
