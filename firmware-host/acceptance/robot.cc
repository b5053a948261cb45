// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/robot.h"

#include <optional>
#include <utility>

#include "firmware-host/acceptance/scripts.h"
#include "firmware-host/acceptance/state_words.h"

namespace bendloop::host {
namespace {

hal::Result<void> Device(const Plc& plc, const std::string& why) {
  return hal::Fail(hal::ErrorKind::kDevice, "bender " + plc.Name() + ": " + why);
}

// The program that stands there, if the robot can work from it.
hal::Result<RegisterProgram> FindProgram(Plc& plc) {
  const auto state = plc.State();
  const auto active = plc.Active();
  if (const auto trouble = plc.TakeTrouble()) {
    return hal::Fail(hal::ErrorKind::kDevice, trouble->text);
  }
  const auto no = [&](const std::string& why) { return hal::Fail(Device(plc, why).error()); };
  if (state->mode != plc.map().mode_idle) {
    return no("its mode is " + std::to_string(state->mode) + "; idle (" +
              std::to_string(plc.map().mode_idle) +
              ") was expected: bring the machine to set-up mode, ready for a program");
  }
  if (active->row_count < 2) {
    return no(
        "it holds no program; send one (bendloop first-program --send) or load one at the "
        "panel");
  }
  const bool keyed_in = active->sequence == 0 && active->crc == 0;
  if (!keyed_in && plc.form().Crc(*active) != active->crc) {
    return no(
        "the active program's crc does not fit its rows: half-written, or a PLC that computes "
        "another crc (drivers/README.md); load a program at the panel");
  }
  return *active;
}

void Play(Bench& bench, HandSteps& hands) {
  PlayIdentity(bench);
  PlayStaging(bench);
  PlayCommits(bench);
  PlayRejections(bench);
  PlayHandSteps(bench, hands);
  PlayWrapAround(bench);
}

void WatchHeartbeatToItsEnd(Plc& plc, Bench& bench) {
  bench.Run("the heartbeat over the whole run", [&] {
    if (!plc.has_heartbeat()) return bench.LeaveOut("the register map has no heartbeat");
    const auto longest =
        std::chrono::duration_cast<std::chrono::milliseconds>(plc.longest_standstill());
    bench.Expect(Rule::kHeartbeat, longest <= kSlowestBeat,
                 "it stood still for " + std::to_string(longest.count()) + " ms");
  });
}

}  // namespace

hal::Result<std::string> RestoreAfterCut(Plc& plc, const RestoreFile& file,
                                         const BenchOptions& options) {
  const auto left = file.Read();
  if (!left) return hal::Fail(left.error());
  if (!*left) return std::string("nothing is left to put back");
  if (!plc.Connect()) return hal::Fail(hal::ErrorKind::kDevice, plc.TakeTrouble()->text);
  if (auto ok = RestoreProgram(plc, **left, {options.reply_timeout, options.poll_period}); !ok) {
    return hal::Fail(ok.error());
  }
  if (auto ok = file.Remove(); !ok) return hal::Fail(ok.error());
  return "the program that an earlier run found is active again: part " +
         std::to_string((*left)->part_number) + ", sequence " + std::to_string((*left)->sequence);
}

hal::Result<Acceptance> RunAcceptance(Plc& plc, const RestoreFile& file, HandSteps& hands,
                                      const RobotOptions& options) {
  if (!plc.Connect()) return hal::Fail(hal::ErrorKind::kDevice, plc.TakeTrouble()->text);
  if (auto ok = RestoreAfterCut(plc, file, options.bench); !ok) return hal::Fail(ok.error());
  Acceptance result;
  result.bender = plc.Name();
  result.register_map = plc.map().name;
  const auto begin = plc.clock().Now();
  Bench bench(plc, result, options.bench, options.on_exchange);
  const auto found = FindProgram(plc);
  if (!found) {
    if (!PlaySenseless(bench)) return hal::Fail(found.error());
    bench.ExplainAll("the PLC's registers make no sense by this map");
    result.restored = true;  // nothing was written
    return result;
  }
  const auto block = plc.form().ToBlock(*found);
  if (!block) return hal::Fail(block.error());
  result.found = *block;
  if (!bench.Begin(*found)) return hal::Fail(hal::ErrorKind::kDevice, plc.TakeTrouble()->text);
  plc.WatchHeartbeat();
  if (plc.map().commit) {
    if (auto ok = file.Keep(*found, result.bender); !ok) return hal::Fail(ok.error());
    Play(bench, hands);
  } else {
    PlayIdentity(bench);
    bench.ExplainAll("the register map has no commit register");
  }
  WatchHeartbeatToItsEnd(plc, bench);

  auto restored =
      plc.map().commit
          ? RestoreProgram(plc, *found, {options.bench.reply_timeout, options.bench.poll_period})
          : hal::Result<void>();
  if (restored) restored = file.Remove();
  result.restored = restored.has_value();
  if (!restored && result.trouble.empty()) result.trouble = restored.error().message;
  result.timing = plc.timing().Summarise();
  result.took = plc.clock().Now() - begin;
  return result;
}

}  // namespace bendloop::host
