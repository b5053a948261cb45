// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/scripts.h"
#include "firmware-host/acceptance/state_words.h"

namespace bendloop::host {
namespace {

void PlayHeartbeat(Bench& bench) {
  constexpr std::size_t kBeats = 3;
  bench.Run("the heartbeat counts", [&] {
    Plc& plc = bench.plc();
    if (!plc.has_heartbeat()) return bench.LeaveOut("the register map has no heartbeat");
    while (plc.beats() < kBeats && plc.longest_standstill() <= kSlowestBeat && plc.State()) {
      plc.clock().SleepFor(bench.options().poll_period);
    }
    bench.Expect(Rule::kHeartbeat, plc.beats() >= kBeats,
                 "it did not count for more than a second");
  });
}

}  // namespace

void PlayIdentity(Bench& bench) {
  Plc& plc = bench.plc();
  bench.Explain(Rule::kHeartbeat, "the register map has no heartbeat");
  PlayHeartbeat(bench);
  bench.Run("the daemon's link reads state and program", [&] {
    const auto state = plc.link().ReadState();
    const auto active = plc.link().ReadActive();
    bench.Refute(Rule::kMode, state.has_value(), state ? "" : state.error().message);
    bench.Refute(Rule::kPanel, active.has_value(), active ? "" : active.error().message);
  });
  bench.Run("mode is a code of the map", [&] {
    const auto state = plc.State();
    if (state) ExpectKnownMode(bench, *state);
  });
  bench.Run("the active program's crc is right", [&] {
    const auto active = plc.Active();
    if (active) ExpectRightCrc(bench, *active);
  });
  bench.Run("the active program stays the same while nothing is asked",
            [&] { bench.ExpectQuiet("nothing"); });
}

}  // namespace bendloop::host
