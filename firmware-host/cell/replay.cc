// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/replay.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "drivers/session/session_source.h"
#include "firmware-host/acquisition/acquisition.h"
#include "firmware-host/cell/cell_loop.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/run_context.h"
#include "firmware-host/cell/tube_rules.h"

namespace bendloop::host {
namespace {

// What the session's meta says beside its points.
struct Recorded {
  ScanIdentity identity;
  std::optional<RunContext> context;
  std::optional<Moment> ended;  // by the wall clock alone
};

// The recorded end of the scan, or its start, as far as the session says either.
std::optional<Moment> EndOf(const drivers::SessionReader& reader) {
  auto unix_ms = ParseUtc(reader.MetaOr(kEndKey, ""));
  if (!unix_ms) unix_ms = ParseUtc(reader.MetaOr(kStartKey, ""));
  if (!unix_ms) return std::nullopt;
  return Moment{SystemMoment().boot_ns, *unix_ms};
}

hal::Result<Recorded> ReadRecorded(const drivers::SessionReader& reader, const PartPlan& plan,
                                   std::vector<std::string>& notes) {
  if (auto times = CheckRecordedTimes(reader.meta(), reader.path()); !times) {
    return hal::Fail(times.error());
  }
  Recorded recorded;
  recorded.identity.session =
      reader.MetaOr("session", std::filesystem::path(reader.path()).stem().string());
  recorded.identity.start = reader.MetaOr(kStartKey, "");
  recorded.identity.tube = reader.MetaOr("identity", "");
  if (const std::string text = reader.MetaOr(kContextKey, ""); !text.empty()) {
    auto context = ReadRunContext(text, reader.path() + ": meta 'context'");
    if (!context) return hal::Fail(context.error());
    recorded.context = std::move(*context);
  }
  recorded.ended = EndOf(reader);
  if (const std::string part = reader.MetaOr("part", plan.part); part != plan.part) {
    notes.push_back("the session is of part '" + part + "', the cell makes '" + plan.part + "'");
  }
  const std::string digest = reader.MetaOr("config_digest", plan.config_digest);
  if (digest != plan.config_digest) {
    notes.push_back("the session was recorded with other settings (" + digest +
                    ", the cell's are " + plan.config_digest + "): the result may differ");
  }
  if (reader.MetaOr("recording", "complete") != "complete") {
    notes.push_back("the recording has gaps that the live run did not have");
  }
  return recorded;
}

hal::Result<std::unique_ptr<BenderDesk>> OpenDesk(const config::CellConfig& cell,
                                                  const PartPlan& plan, const Recorded& recorded,
                                                  const ReplayOptions& options, hal::Clock& clock) {
  BenderDesk::Options desk;
  desk.journal = IsReal(cell.bender.link) ? options.journal : ":memory:";
  desk.pipe_radius_mm = plan.pipe_radius_mm;
  desk.commit = plan.commit;
  desk.ledger = LedgerRulesOf(cell);
  desk.read_only = IsReal(cell.bender.link) && !options.send;
  if (cell.bender.link != config::BenderKind::kSimulated) {
    return BenderDesk::Open(cell.bender, desk, clock);
  }
  desk.ledger = {.counted = false};  // nobody bends with it
  // The simulated bender holds what the real one held.
  const auto* const context = recorded.context ? &*recorded.context : nullptr;
  if (context != nullptr && (context->expected || context->bent_with)) {
    desk.preload = context->expected ? *context->expected : *context->bent_with;
  } else {
    auto first = pipeline::InitialProgram(plan.nominal, plan.correction.material);
    if (!first) return hal::Fail(first.error());
    desk.preload.part_number = plan.part_number;
    desk.preload.program = std::move(*first);
  }
  auto opened = BenderDesk::Open(cell.bender, desk, clock);
  if (opened && recorded.context) (*opened)->NoteSequence(recorded.context->last_sequence);
  return opened;
}

hal::Result<PartPlan> PlanOf(const config::CellConfig& cell) {
  auto plan = MakePartPlan(cell);
  if (plan && !WhyNothingIsCorrected(cell).empty()) plan->corrects = false;
  return plan;
}

// A recording that says nothing of its age or its tube is too old, and of none.
void WillSend(const Recorded& recorded, const BenderDesk& desk, CellPorts& ports) {
  ports.recorded_end = recorded.ended.value_or(Moment{});
  if (!ports.recorded && desk.counts_tubes()) ports.recorded.emplace();
}

CellLoopOptions LoopOf(const config::CellConfig& cell) {
  CellLoopOptions options;
  options.scan.is_live = false;
  options.scan.max_seconds = cell.scan.max_seconds;
  options.scan.min_profiles = cell.scan.min_profiles;
  options.scan.ends_by_coverage = cell.scan.end == config::ScanEnd::kCoverage;
  options.max_parts = 1;
  return options;
}

// A recording waits when the ring is full, so few slots lose nothing; and a file's word on the size
// of its profiles must not take all memory.
std::size_t RingSlots(const config::CellConfig& cell, std::size_t max_points) {
  constexpr std::size_t kMostPointsWaiting = 4'000'000;
  constexpr std::size_t kFewestSlots = 16;
  const std::size_t fit =
      std::max(kFewestSlots, kMostPointsWaiting / std::max<std::size_t>(max_points, 1));
  return std::min<std::size_t>(cell.scanner.queue_profiles, fit);
}

// Damaged profiles are missing ones to the interlocks; here a person is told.
void TellDamage(const drivers::SessionSource& source, bool decided, Replay& replay,
                std::optional<hal::Error>& failed) {
  const drivers::SessionReader& reader = *source.reader();
  if (reader.has_sums() && reader.MetaOr("digest", "").empty()) {
    replay.notes.push_back("the recording was never closed: it ends where it was cut off");
  }
  if (source.profiles_left_out() == 0) return;
  const std::string words =
      std::to_string(source.profiles_left_out()) +
      " damaged profiles of the session are left out; the first: " + source.first_damage();
  if (decided) replay.outcome.result.measurement.warnings.push_back(words);
  if (failed) failed->message += " (" + words + ")";
}

}  // namespace

hal::Result<Replay> ReplaySession(const config::CellConfig& cell, const ReplayOptions& options,
                                  hal::Clock& clock) {
  auto plan = PlanOf(cell);
  if (!plan) return hal::Fail(plan.error());
  if (!options.config_digest.empty()) plan->config_digest = options.config_digest;
  drivers::SessionSource source(
      options.session.string(),
      options.recorded_pace ? drivers::ReplayPace::kRecorded : drivers::ReplayPace::kMax, clock);
  const auto info = source.Open();
  if (!info) return hal::Fail(info.error());
  Replay replay;
  const auto recorded = ReadRecorded(*source.reader(), *plan, replay.notes);
  if (!recorded) return hal::Fail(recorded.error());
  auto desk = OpenDesk(cell, *plan, *recorded, options, clock);
  if (!desk) return hal::Fail(desk.error());

  StatusBoard board;
  std::optional<hal::Error> failed;
  bool decided = false;
  CellPorts ports;
  ports.clock = &clock;
  ports.desk = desk->get();
  ports.board = &board;
  ports.identify = [&] { return recorded->identity; };
  ports.recorded = recorded->context;
  if (IsReal(cell.bender.link) && options.send) WillSend(*recorded, **desk, ports);
  ports.lot = [&] { return options.lot; };
  ports.part_done = [&](PartOutcome outcome) {
    replay.outcome = std::move(outcome);
    decided = true;
  };
  ports.scan_failed = [&](const FailedScan& scan) { failed = scan.error; };
  CellLoop loop(*plan, std::move(ports), LoopOf(cell));

  ProfileRing ring(RingSlots(cell, info->max_points), info->max_points);
  Acquisition acquisition(source, *info, ring, clock, {});
  if (auto started = acquisition.Start(); !started) return hal::Fail(started.error());
  const CellEnd end = loop.Run(acquisition, ring, *info);
  acquisition.Stop();
  if (const std::size_t missed = source.reader()->points_left_out(); missed > 0) {
    const std::string words =
        std::to_string(missed) + " points of the session are not finite numbers and are left out";
    if (decided) replay.outcome.result.measurement.warnings.push_back(words);
    if (failed) failed->message += " (" + words + ")";
  }
  TellDamage(source, decided, replay, failed);
  if (decided) return replay;
  if (end == CellEnd::kSourceFault) return hal::Fail(acquisition.fault());
  if (end == CellEnd::kPartsDone && failed && !acquisition.fault().message.empty()) {
    return hal::Fail(acquisition.fault());
  }
  const std::string where = options.session.string() + ": ";
  if (failed) return hal::Fail(hal::ErrorKind::kBadInput, where + failed->message);
  return hal::Fail(hal::ErrorKind::kBadInput,
                   where + "holds no scan: found no profile, expected at least " +
                       std::to_string(cell.scan.min_profiles));
}

}  // namespace bendloop::host
