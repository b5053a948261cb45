// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <functional>

#include "firmware-host/history/history.h"
#include "live_cell.h"

namespace bendloop::testing {
namespace {

using host::CommitOutcome;
using ::testing::HasSubstr;

// Of a part that was held: its reason.
std::string Reason(const std::optional<host::RunResult>& result) {
  return result && result->bender ? result->bender->reason : "";
}

double WorstAngle(const hal::BendProgram& tube, const hal::BendProgram& nominal) {
  double worst = 0;
  for (std::size_t i = 0; i < nominal.bend_count(); ++i) {
    worst = std::max(worst, std::abs(tube.rows[i].angle_deg - nominal.rows[i].angle_deg));
  }
  return worst;
}

TEST(LiveCell, ATubeScannedTwiceIsCorrectedOnceAndLearntFromOnce) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  const auto first = cell.Scan(tube, 1, "committed");
  const auto lot = Slurp(cell.scratch() / "state/lot.json");
  const auto again = cell.Scan(tube, 2, "refused");
  ASSERT_TRUE(again && again->interlocks);
  EXPECT_THAT(again->interlocks->refusals(),
              ::testing::Contains(HasSubstr("no new tube was bent")));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_EQ(lot, Slurp(cell.scratch() / "state/lot.json"));
  cell.Scan(cell.Bend(), 3, "committed");
}

TEST(LiveCell, AlarmsAreSaidEverywhereAndEnd) {
  LiveCell cell;
  cell.StartDaemon();
  cell.Misbehave("silent");
  ASSERT_TRUE(cell.Becomes("/alarms/0/code", "BL4001")) << cell.log();
  const auto shown = cell.scratch().Bendloop("status --config " + cell.cell_file());
  EXPECT_THAT(shown.out, HasSubstr("alarm BL4001 (fault, since "));
  const auto address = host::Json::parse(Slurp(cell.scratch() / "state/status.json"));
  const auto metrics = host::FetchLocal(address.at("port").get<std::uint16_t>(), "/metrics");
  ASSERT_TRUE(metrics) << metrics.error().message;
  EXPECT_THAT(*metrics, HasSubstr("bendloop_alarm_active{code=\"BL4001\",severity=\"fault\"} 1"));
  cell.Misbehave("behave");
  ASSERT_TRUE(cell.HasAlarm("BL4001", "alarms_ended")) << cell.log();
  // A tube that nobody bent.
  const auto tube = cell.Bend();
  cell.Scan(tube, 1, "committed");
  cell.Misbehave("set-count 4000");
  cell.Scan(tube, 2, "refused");
  ASSERT_TRUE(cell.HasAlarm("BL3006")) << cell.log();
  cell.Scan(cell.Bend(), 3, "committed");
  ASSERT_TRUE(cell.HasAlarm("BL3006", "alarms_ended")) << cell.log();
  cell.StopDaemon();
  EXPECT_THAT(cell.log(), HasSubstr("alarm=BL4001 event=began severity=fault text=\""));
  EXPECT_THAT(cell.log(), HasSubstr("alarm=BL4001 event=ended"));
  const auto history = host::History::Open(cell.scratch() / "state/history.db");
  ASSERT_TRUE(history);
  const auto alarms = history->LastAlarms(50);
  ASSERT_TRUE(alarms);
  EXPECT_TRUE(std::any_of(alarms->begin(), alarms->end(), [](const host::Alarm& alarm) {
    return alarm.code == host::AlarmCode::kTubeCount && !alarm.is_active();
  }));
}

TEST(LiveCell, ASweepThatGoesOnAfterTheTubeIsCoveredIsOnePart) {
  LiveCell cell("[scan]\nend = \"coverage\"\nsilence_seconds = 1\n");
  cell.StartDaemon();
  const std::size_t profiles = cell.Sweep(cell.Bend(), 4);
  ASSERT_TRUE(cell.Result(1, "committed"));
  // To the end of the sweep.
  ASSERT_TRUE(cell.Becomes("/health/profiles", profiles)) << cell.log();
  ASSERT_TRUE(cell.Becomes("/health/queue_now", 0));
  cell.StopDaemon();
  EXPECT_EQ(cell.results(), 1u);
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
}

// A sweep is cut in half by a restart and begins anew, and goes on after another one: the tube is
// corrected and learnt from once.
void ExpectOneDecisionThrough(LiveCell& cell, const std::function<void()>& restart) {
  cell.StartDaemon();
  const auto tube = cell.Bend();
  const std::size_t half = cell.Sweep(tube, 0.5);
  ASSERT_TRUE(cell.Becomes("/health/profiles", half)) << cell.log();
  ASSERT_TRUE(cell.Becomes("/state", "scanning")) << cell.log();
  restart();
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);

  cell.Sweep(tube, 2);
  ASSERT_TRUE(cell.Becomes("/last_part/end", "corrected")) << cell.log();
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  // Half a sweep may have left a result, too.
  const auto number = static_cast<unsigned>(cell.results());
  const auto lot = Slurp(cell.scratch() / "state/lot.json");
  restart();

  cell.Sweep(tube, 1);
  const auto again = cell.Result(number + 1, "refused");
  ASSERT_TRUE(again && again->interlocks);
  EXPECT_THAT(again->interlocks->refusals(),
              ::testing::Contains(HasSubstr("no new tube was bent")));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_EQ(lot, Slurp(cell.scratch() / "state/lot.json"));
}

// Longer than the test takes: nothing ends by silence.
constexpr char kSweeping[] = "[scan]\nend = \"coverage\"\nsilence_seconds = 120\n";

TEST(LiveCell, ASweepThroughARestartOfTheDaemonIsOneDecision) {
  LiveCell cell(kSweeping);
  ExpectOneDecisionThrough(cell, [&] {
    cell.StopDaemon();
    cell.StartDaemon();
  });
}

TEST(LiveCell, ASweepThroughARestartOfTheScannerIsOneDecision) {
  LiveCell cell(kSweeping);
  ExpectOneDecisionThrough(cell, [&] { cell.RestartScanner(); });
}

TEST(LiveCell, ASecondPassAfterTheSilenceIsARepeatOfItsTube) {
  LiveCell cell("[scan]\nend = \"coverage\"\nsilence_seconds = 0.5\n");
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Sweep(tube, 1);
  ASSERT_TRUE(cell.Result(1, "committed"));
  const auto lot = Slurp(cell.scratch() / "state/lot.json");
  cell.AwaitSilence(std::chrono::seconds(1));
  cell.Sweep(tube, 1);
  const auto again = cell.Result(2, "refused");
  EXPECT_TRUE(again && again->repeat_of == "part-0001");
  EXPECT_TRUE(cell.Becomes("/last_part/end", "repeat")) << cell.log();
  EXPECT_TRUE(cell.Becomes("/parts/repeats", 1));
  EXPECT_TRUE(cell.Becomes("/parts/refused", 0));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_EQ(lot, Slurp(cell.scratch() / "state/lot.json"));
  cell.AwaitSilence(std::chrono::seconds(1));
  cell.Sweep(cell.Bend(), 1);
  const auto next = cell.Result(3);
  EXPECT_TRUE(next && next->repeat_of.empty());
  cell.StopDaemon();
  // A replay says the same.
  const std::string json = (cell.scratch() / "again.json").string();
  const auto session = (cell.scratch() / "state/sessions/part-0002.session").string();
  EXPECT_EQ(cell.scratch()
                .Bendloop("replay " + session + " --config " + cell.cell_file() + " --json " + json)
                .code,
            1);
  const auto replayed = host::ReadResultJson(Slurp(json), json);
  EXPECT_TRUE(replayed && replayed->repeat_of == "part-0001");
}

// The last tube of a batch that is bent one ahead: nobody can tell it from the one before it.
TEST(LiveCell, TheLastTubeOfABatchIsMeasuredAndNotActedOn) {
  LiveCell cell("[scan]\nparts_between = 1\n");
  cell.StartDaemon();
  const auto first = cell.Bend();
  const auto last = cell.Bend();
  cell.Scan(first, 1, "committed");
  const auto lot = Slurp(cell.scratch() / "state/lot.json");
  const auto result = cell.Scan(last, 2, "refused");
  ASSERT_TRUE(result && result->inspection);
  EXPECT_TRUE(result->repeat_of.empty());
  ASSERT_TRUE(result->interlocks);
  EXPECT_THAT(result->interlocks->refusals(),
              ::testing::Contains(HasSubstr("one of the 1 that lie between bender and scan")));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  EXPECT_EQ(lot, Slurp(cell.scratch() / "state/lot.json"));
}

TEST(LiveCell, ARecordingOf2020IsNotSentToARealBender) {
  LiveCell cell;
  const std::string session = (cell.scratch() / "old.session").string();
  ASSERT_EQ(cell.scratch()
                .Bendloop("simulate --part " BENDLOOP_SOURCE_DIR "/config/parts/demo.toml --out " +
                          session + " --spacing 1 --rays 200 --views 2 --seed 4 --springback-120 6")
                .code,
            0);
  const hal::ProgramBlock before = cell.bender().Active();
  const std::string json = (cell.scratch() / "result.json").string();
  const std::string replay =
      "replay " + session + " --config " + cell.cell_file() + " --json " + json;
  EXPECT_EQ(cell.scratch().Bendloop(replay).code, 1);
  EXPECT_EQ(cell.bender().Active(), before);
  const Ran sent = cell.scratch().Bendloop(replay + " --send");
  EXPECT_EQ(sent.code, 1);
  EXPECT_EQ(cell.bender().Active(), before);
  const auto result = host::ReadResultJson(Slurp(json), json);
  ASSERT_TRUE(result && result->interlocks);
  bool is_stale = false;
  for (const auto& check : result->interlocks->checks) {
    is_stale |= check.kind == pipeline::InterlockKind::kStaleSession && !check.passed;
  }
  EXPECT_TRUE(is_stale) << sent.err;
}

TEST(LiveCell, TheWatchdogIsFedWhileTheBenderIsSlowToAcknowledge) {
  LiveCell cell("", "commit_timeout_ms = 60000\n");
  const auto path = (cell.scratch() / "notify").string();
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  setenv("NOTIFY_SOCKET", path.c_str(), 1);
  setenv("WATCHDOG_USEC", "400000", 1);
  unsetenv("WATCHDOG_PID");
  cell.StartDaemon();
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  cell.Misbehave("ack-late 600000");
  cell.Trigger(cell.Bend());
  // A socket that nobody reads takes ten messages; the next one would make the daemon wait.
  char text[4096];
  const auto drain = [&] {
    while (::recv(socket, text, sizeof text, MSG_DONTWAIT) > 0) {
    }
  };
  ASSERT_TRUE(LiveCell::Until([&] {
    drain();
    return cell.bender().Staged().sequence != 0;
  }));
  ASSERT_TRUE(cell.Becomes("/state", "committing"));
  // Many beats come while the commit is not acknowledged; each takes a tenth of a second.
  drain();
  int beats = 0;
  ASSERT_TRUE(LiveCell::Until([&] {
    const ssize_t size = ::recv(socket, text, sizeof text, MSG_DONTWAIT);
    if (size > 0 && std::string(text, static_cast<std::size_t>(size)) == "WATCHDOG=1") ++beats;
    return beats >= 20;
  }));
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
  cell.Misbehave("reboot");  // the commit is lost; the bender is there
  close(socket);
}

TEST(LiveCell, TubesThatWaitBetweenBenderAndScannerKeepTheProgramThatBentThem) {
  LiveCell cell("[scan]\nparts_between = 1\n");
  cell.StartDaemon();
  const hal::ProgramBlock first = cell.bender().Active();
  std::vector<hal::BendProgram> tubes = {cell.Bend(), cell.Bend()};
  for (unsigned n = 1; n <= 4; ++n) {
    const auto result = cell.Scan(tubes[n - 1], n, "");
    ASSERT_TRUE(result && result->commanded);
    if (n <= 2) {
      EXPECT_EQ(result->commanded->sequence, first.sequence) << n;
    }
    tubes.push_back(cell.Bend());
  }
  // No oscillation: the first correction takes the whole error away, those that follow find that.
  for (std::size_t i = 2; i < tubes.size(); ++i) {
    EXPECT_LT(WorstAngle(tubes[i], cell.plan().nominal),
              0.35 * WorstAngle(tubes[0], cell.plan().nominal))
        << i;
  }
}

TEST(LiveCell, AnotherPartsProgramIsNeverTouched) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("other-program");
  const hal::ProgramBlock other = cell.bender().Active();
  const auto result = cell.Scan(tube, 1, "refused");
  EXPECT_THAT(Reason(result), HasSubstr("nothing was sent"));
  EXPECT_EQ(cell.bender().Active(), other);
  // A tube of the other part is not corrected, either; the first one might still be this one.
  cell.Scan(cell.Bend(), 2, "refused");
  const auto third = cell.Scan(cell.Bend(), 3, "refused");
  ASSERT_TRUE(third && third->interlocks);
  EXPECT_THAT(third->interlocks->refusals(),
              ::testing::Contains(HasSubstr("this cell makes part")));
  EXPECT_EQ(cell.bender().Active(), other);
}

TEST(LiveCell, AnEditAtThePanelAfterTheBendIsNotOverwritten) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("edit 6");
  const hal::ProgramBlock edited = cell.bender().Active();
  const auto result = cell.Scan(tube, 1, "refused");
  EXPECT_EQ(cell.bender().Active(), edited);
  EXPECT_FALSE(Reason(result).empty());
}

TEST(LiveCell, ALateAnswerAtTheScansStartLosesNothing) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("late 900");
  cell.Trigger(tube);
  ASSERT_TRUE(LiveCell::Until([&] {
    const auto status = host::FetchStatus(cell.scratch() / "state/status.json");
    return status && (status->contains("scan") || status->value("state", "") == "deciding" ||
                      status->value("state", "") == "committing" || cell.results() > 0);
  }));
  cell.Misbehave("behave");
  EXPECT_TRUE(cell.Result(1, "committed"));
}

TEST(LiveCell, ACorrectionWaitsForABenderThatBends) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("mode bending");
  const auto waits = cell.Scan(tube, 1, "waiting");
  EXPECT_THAT(Reason(waits), HasSubstr("bending"));
  EXPECT_TRUE(cell.Becomes("/last_part/end", "waiting"));
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
  cell.Misbehave("mode idle");
  EXPECT_TRUE(cell.Result(1, "committed"));
  EXPECT_TRUE(cell.Becomes("/last_part/end", "corrected"));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
}

TEST(LiveCell, ACrashInTheCommitOfWhatWaitedIsNotToldAsRefused) {
  LiveCell cell("",
                "commit_timeout_ms = 60000\nconnect_timeout_ms = 200\nresponse_timeout_ms = 200\n");
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("mode bending");
  cell.Scan(tube, 1, "waiting");
  cell.Misbehave("ack-late 600000");
  cell.Misbehave("mode idle");
  ASSERT_TRUE(LiveCell::Until([&] { return cell.bender().Staged().sequence != 0; })) << cell.log();
  cell.KillDaemon();
  cell.Misbehave("silent");
  cell.StartDaemon();
  const auto open = cell.Result(1);
  ASSERT_TRUE(open && open->bender);
  EXPECT_EQ(open->bender->outcome, CommitOutcome::kUnknown) << open->bender->reason;
  cell.Misbehave("behave");
  cell.Misbehave("reboot");  // the commit is lost
  const auto settled = cell.Result(1, "failed");
  EXPECT_THAT(Reason(settled), HasSubstr("the old program is active"));
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
  // Its tube is used up: no correction comes after what was told.
  EXPECT_TRUE(cell.Scan(tube, 2, "refused"));
}

TEST(LiveCell, AWaitThatTheDaemonsEndCutsShortIsToldOnce) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("mode bending");
  cell.Scan(tube, 1, "waiting");
  cell.KillDaemon();
  cell.Misbehave("mode idle");
  cell.StartDaemon();
  EXPECT_THAT(Reason(cell.Result(1, "refused")),
              HasSubstr("while the correction waited for the bender"));
  const auto again = cell.Scan(tube, 2, "refused");
  EXPECT_TRUE(again && again->repeat_of == "part-0001");
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
}

// Results, history and sessions tell; what a cell may act on is decided by the journal alone.
TEST(LiveCell, WhatWasDecidedStandsInTheJournalAlone) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Scan(tube, 1, "committed");
  cell.StopDaemon();
  for (const char* told :
       {"state/results", "state/sessions", "state/history.db", "state/lot.json"}) {
    std::filesystem::remove_all(cell.scratch() / told);
  }
  cell.StartDaemon();
  const auto again = cell.Scan(tube, 2, "refused");
  EXPECT_TRUE(again && again->repeat_of == "part-0001");
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
}

TEST(LiveCell, WhatWaitsIsNotSentWhenTheProgramHasChanged) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("mode bending");
  cell.Scan(tube, 1, "waiting");
  cell.Misbehave("edit 2");
  cell.Misbehave("mode idle");
  EXPECT_TRUE(cell.Result(1, "refused"));
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
}

TEST(LiveCell, AnUnknownEndIsSettledEverywhereWhenTheBenderIsBack) {
  LiveCell cell("",
                "commit_timeout_ms = 500\nconnect_timeout_ms = 200\nresponse_timeout_ms = 200\n");
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("away-after-commit");
  ASSERT_TRUE(cell.Scan(tube, 1, "unknown"));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  cell.Misbehave("behave");
  ASSERT_TRUE(cell.Result(1, "committed"));
  EXPECT_TRUE(cell.Becomes("/last_part/end", "corrected"));
  cell.StopDaemon();
  const auto history = host::History::Open(cell.scratch() / "state/history.db");
  ASSERT_TRUE(history);
  const auto parts = history->Last(5);
  ASSERT_TRUE(parts && parts->size() == 1 && parts->at(0).result.bender);
  EXPECT_EQ(parts->at(0).result.bender->outcome, CommitOutcome::kCommitted);
}

TEST(LiveCell, NamesThatTheJournalKnowsDoNotComeAgain) {
  LiveCell cell;
  cell.StartDaemon();
  cell.Scan(cell.Bend(), 1, "committed");
  cell.StopDaemon();
  for (const char* folder : {"state/results", "state/sessions"}) {
    std::filesystem::remove_all(cell.scratch() / folder);
  }
  cell.StartDaemon();
  EXPECT_TRUE(cell.Scan(cell.Bend(), 2, "committed"));
}

TEST(LiveCell, ARestartBetweenBendAndScanLosesNothing) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.StopDaemon();
  cell.StartDaemon();
  EXPECT_TRUE(cell.Scan(tube, 1, "committed"));
}

TEST(LiveCell, ACountThatJumpsIsSaid) {
  LiveCell cell;
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Misbehave("set-count 4000");
  const auto result = cell.Scan(tube, 1, "refused");
  ASSERT_TRUE(result && result->interlocks);
  EXPECT_THAT(result->interlocks->refusals(), ::testing::Contains(HasSubstr("jumped from")));
}

TEST(LiveCell, AScanThatFailsLeavesAResult) {
  LiveCell cell("[scan]\nmin_profiles = 1000000\n");
  cell.StartDaemon();
  cell.Trigger(cell.Bend());
  EXPECT_TRUE(LiveCell::Until([&] {
    return Slurp(cell.scratch() / "state/results/part-0001.json")
               .find("expected at least 1000000") != std::string::npos;
  })) << cell.log();
}

TEST(LiveCell, WithoutACountOfTubesNothingIsCorrectedAndCheckSaysSo) {
  LiveCell cell;
  std::string map = Slurp(BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml");
  map.erase(map.find("parts_bent"),
            map.find('\n', map.find("parts_bent")) - map.find("parts_bent"));
  std::ofstream(cell.scratch() / "map.toml") << map;
  std::string toml = Slurp(cell.cell_file());
  const std::string shipped = BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml";
  toml.replace(toml.find(shipped), shipped.size(), "map.toml");
  std::ofstream(cell.cell_file()) << toml;
  const Ran check = cell.scratch().Bendloop("check " + cell.cell_file());
  EXPECT_EQ(check.code, 0) << check.err;
  EXPECT_THAT(check.err, HasSubstr("corrections are off"));
  cell.StartDaemon();
  const auto part = cell.bender().Bend();
  ASSERT_TRUE(part);
  const auto result = cell.Scan(part->tube, 1, "");
  EXPECT_TRUE(result && !result->bender);
  EXPECT_EQ(cell.bender().commits_accepted(), 0u);
}

}  // namespace
}  // namespace bendloop::testing
