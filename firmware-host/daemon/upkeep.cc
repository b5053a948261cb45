// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/upkeep.h"

#include <spdlog/spdlog.h>

#include <cmath>
#include <cstdio>

#include "firmware-host/ledger/moment.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

// Of what is too old: nothing is in a hurry to go.
constexpr auto kDropPeriod = 24h;
// Where that did not come to its end.
constexpr auto kDropAgain = 10min;

std::chrono::nanoseconds Hours(double hours) {
  return std::chrono::nanoseconds(std::llround(hours * 3.6e12));
}

}  // namespace

Upkeep::Upkeep(const config::StorageConfig& storage, const hal::Clock& clock, AlarmBoard& alarms,
               PartKeeper& keeper, const StatusBoard& board)
    : storage_(storage),
      clock_(clock),
      alarms_(alarms),
      keeper_(keeper),
      board_(board),
      shift_(Hours(storage.shift_hours), clock.Now()) {}

void Upkeep::Do(BenderDesk& desk) {
  WatchClock();
  WatchNeighbours();
  DropOld(desk);
  if (shift_.IsDue(clock_.Now())) TellShift();
}

void Upkeep::PartDone(const std::string& verdict, bool is_corrected) {
  const CellSnapshot cell = board_.Get();
  const bool is_measured = !verdict.empty();
  shift_.PartDone(verdict, is_corrected, is_measured ? cell.last_lra_ms : 0,
                  is_measured ? cell.last_end_ms : 0);
}

void Upkeep::TellShift() { spdlog::info("{}", shift_.Take(clock_.Now(), board_.Get(), alarms_)); }

void Upkeep::TellLastShift() {
  if (!shift_.IsIdle(alarms_)) TellShift();
}

// At the start, and once a day.
void Upkeep::DropOld(BenderDesk& desk) {
  const auto now = clock_.Now();
  if (drop_due_ && now < *drop_due_) return;
  drop_due_ = now + kDropAgain;  // want of memory may end it anywhere
  const auto in_hand = desk.SessionsInHand();
  // What the journal cannot tell may be one that is to be kept.
  if (!in_hand) return;
  bool is_done = keeper_.DropOld(*in_hand);
  if (storage_.max_age_days > 0) {
    const auto dropped = desk.DropOld(storage_.max_age_days);
    if (!dropped) spdlog::warn("{}", dropped.error().message);
    is_done = is_done && dropped;
  }
  if (is_done) drop_due_ = now + kDropPeriod;
}

void Upkeep::WatchClock() {
  const std::optional<double> hours = clock_watch_.Step(SystemMoment());
  if (!hours) return;
  char text[64];
  std::snprintf(text, sizeof text, "by %+.2f hours", *hours);
  alarms_.Begin(AlarmCode::kClockStepped, text);
}

void Upkeep::WatchNeighbours() {
  const auto now = clock_.Now();
  if (!neighbours_.IsDue(now)) return;
  neighbours_.Look(now, LookAtMachine());
  const auto& crowded = neighbours_.crowded();
  alarms_.Set(AlarmCode::kProcessorsTaken, crowded.has_value(), crowded.value_or(""));
  const auto& swaps = neighbours_.swaps();
  alarms_.Set(AlarmCode::kMachineSwaps, swaps.has_value(), swaps.value_or(""));
}

}  // namespace bendloop::host
