// SPDX-License-Identifier: Apache-2.0
// What an appliance meets in months without a keyboard, with the real daemon.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/mount.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "drivers/session/session_reader.h"
#include "firmware-host/history/history.h"
#include "firmware-host/support/tar_file.h"
#include "live_cell.h"

namespace bendloop::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

void HangUp(const LiveCell& cell) {
  const auto address = host::Json::parse(Slurp(cell.scratch() / "state/status.json"));
  ASSERT_EQ(kill(address.at("pid").get<pid_t>(), SIGHUP), 0);
}

// The cell file with a piece of it changed.
void Rewrite(const LiveCell& cell, const std::string& from, const std::string& to) {
  std::string text = Slurp(cell.cell_file());
  const auto at = text.find(from);
  ASSERT_NE(at, std::string::npos) << text;
  std::ofstream(cell.cell_file()) << text.replace(at, from.size(), to);
}

void Spoil(const fs::path& path) {
  ASSERT_TRUE(fs::exists(path)) << path;
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file << std::string(4096, 'x');
}

std::size_t DamagedFiles(const LiveCell& cell, const std::string& name) {
  std::size_t count = 0;
  for (const auto& entry : fs::directory_iterator(cell.scratch() / "state")) {
    if (entry.path().filename().string().starts_with(name + ".damaged-")) ++count;
  }
  return count;
}

TEST(Appliance, AReloadTakesUpNewSettingsBetweenPartsAndRefusesWrongOnes) {
  LiveCell cell;
  cell.StartDaemon();
  ASSERT_TRUE(cell.Becomes("/cell", "test"));
  Rewrite(cell, "name = \"test\"", "name = \"other\"");
  HangUp(cell);
  ASSERT_TRUE(cell.Becomes("/cell", "other")) << cell.log();
  ASSERT_TRUE(cell.Becomes("/state", "waiting for a scan")) << cell.log();
  // A file that is wrong, and a part that is: the old settings go on, and a part is corrected.
  Rewrite(cell, "name = \"other\"", "name = 7");
  HangUp(cell);
  ASSERT_TRUE(cell.HasAlarm("BL5013")) << cell.log();
  cell.Scan(cell.Bend(), 1, "committed");
  ASSERT_TRUE(cell.Becomes("/cell", "other"));
  EXPECT_THAT(cell.log(), HasSubstr("cell.toml:2"));
  Rewrite(cell, "name = 7", "name = \"third\"");
  HangUp(cell);
  ASSERT_TRUE(cell.Becomes("/cell", "third")) << cell.log();
  EXPECT_FALSE(fs::exists(cell.scratch() / "state/results/part-0002.json"));
  cell.Scan(cell.Bend(), 2, "committed");
  cell.StopDaemon();
  EXPECT_EQ(cell.bender().commits_accepted(), 2u);
}

TEST(Appliance, AReloadWaitsForTheScanThatRuns) {
  LiveCell cell("[scan]\nend = \"coverage\"\nsilence_seconds = 1\n");
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Sweep(tube, 0.5);
  ASSERT_TRUE(cell.Becomes("/state", "scanning")) << cell.log();
  Rewrite(cell, "name = \"test\"", "name = \"other\"");
  HangUp(cell);
  cell.Sweep(tube, 1);
  cell.Result(1);
  ASSERT_TRUE(cell.Becomes("/cell", "other")) << cell.log();
  cell.StopDaemon();
}

TEST(Appliance, AStopInTheMiddleOfAScanIsClean) {
  LiveCell cell("[scan]\nend = \"coverage\"\nsilence_seconds = 1\n");
  cell.StartDaemon();
  const auto tube = cell.Bend();
  cell.Sweep(tube, 0.5);
  // What is shorter is not worth keeping (ScanRules::min_profiles).
  ASSERT_TRUE(cell.Reaches("/scan/profiles", 30)) << cell.log();
  cell.StopDaemon();
  const auto session = cell.scratch() / "state/sessions/part-0001.session";
  EXPECT_TRUE(fs::exists(session));
  EXPECT_FALSE(fs::exists(session.string() + "-wal"));  // closed as it should be
  EXPECT_THAT(Slurp(cell.scratch() / "state/results/part-0001.json"),
              HasSubstr("the daemon stops"));
  cell.StartDaemon();
  EXPECT_THAT(cell.log(), Not(HasSubstr("alarm=BL5009")));
  cell.Sweep(tube, 1);
  EXPECT_TRUE(cell.Result(2, "committed"));
  cell.StopDaemon();
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
}

// It is waited for, and told as what it was; the next start has nothing to settle.
TEST(Appliance, AStopInTheMiddleOfACommitIsClean) {
  LiveCell cell("", "commit_timeout_ms = 60000\n");
  cell.StartDaemon();
  cell.Misbehave("ack-late 2000");
  cell.Trigger(cell.Bend());
  ASSERT_TRUE(cell.Becomes("/state", "committing")) << cell.log();
  ASSERT_TRUE(cell.Until([&] { return cell.bender().Staged().sequence != 0; }));
  cell.StopDaemon();
  EXPECT_TRUE(cell.Result(1, "committed"));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  cell.StartDaemon();
  EXPECT_THAT(cell.log(), Not(HasSubstr("alarm=BL5009")));
  cell.Scan(cell.Bend(), 2, "committed");
  cell.StopDaemon();
  EXPECT_EQ(cell.bender().commits_accepted(), 2u);
}

TEST(Appliance, ADamagedHistoryIsMovedAsideAndTold) {
  LiveCell cell;
  cell.StartDaemon();
  cell.Scan(cell.Bend(), 1, "committed");
  cell.StopDaemon();
  Spoil(cell.scratch() / "state/history.db");
  fs::remove(cell.scratch() / "state/report.html");  // of the daemon's end
  cell.StartDaemon();
  ASSERT_TRUE(cell.HasAlarm("BL5010")) << cell.log();
  EXPECT_EQ(DamagedFiles(cell, "history.db"), 1u);
  cell.Scan(cell.Bend(), 2, "committed");
  const Ran listed = cell.scratch().Bendloop("history --config " + cell.cell_file());
  EXPECT_EQ(listed.code, 0) << listed.err;
  EXPECT_THAT(listed.out, HasSubstr("part-0002"));
  EXPECT_THAT(listed.out, Not(HasSubstr("part-0001")));
  const Ran csv = cell.scratch().Bendloop("history --csv - --config " + cell.cell_file());
  EXPECT_THAT(csv.out, HasSubstr("\npart-0002,20"));
  const std::string page = (cell.scratch() / "page.html").string();
  const Ran report =
      cell.scratch().Bendloop("report --out " + page + " --config " + cell.cell_file());
  EXPECT_EQ(report.code, 0) << report.err;
  EXPECT_THAT(report.out, HasSubstr("2 parts, part-0001 to part-0002"));
  EXPECT_THAT(Slurp(page), HasSubstr("</html>"));
  EXPECT_FALSE(fs::exists(cell.scratch() / "state/report.html"));  // that is for every 20th part
  cell.StopDaemon();
  EXPECT_TRUE(fs::exists(cell.scratch() / "state/report.html"));
  EXPECT_THAT(cell.log(), HasSubstr("shift hours=0.0 parts=1 "));
}

TEST(Appliance, ADamagedJournalLocksCorrectionsAndNotMeasuring) {
  LiveCell cell;
  cell.StartDaemon();
  cell.Scan(cell.Bend(), 1, "committed");
  cell.StopDaemon();
  Spoil(cell.scratch() / "state/journal.db");
  for (unsigned part = 2; part <= 3; ++part) {  // restarts or not
    cell.StartDaemon();
    ASSERT_TRUE(cell.HasAlarm("BL5011")) << cell.log();
    const auto refused = cell.Scan(cell.Bend(), part, "refused");
    ASSERT_TRUE(refused);
    EXPECT_TRUE(refused->inspection);
    EXPECT_THAT(refused->bender->reason, HasSubstr("the commit journal was damaged"));
    cell.StopDaemon();
  }
  EXPECT_EQ(DamagedFiles(cell, "journal.db"), 1u);
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  cell.StartDaemon();
  const Ran seen = cell.scratch().Bendloop("acknowledge --config " + cell.cell_file());
  EXPECT_EQ(seen.code, 0) << seen.err;
  ASSERT_TRUE(cell.HasAlarm("BL5011", "alarms_ended")) << cell.log();
  cell.Scan(cell.Bend(), 4, "committed");
  cell.StopDaemon();
  EXPECT_EQ(cell.bender().commits_accepted(), 2u);
}

TEST(Appliance, ASupportBundleTellsAllAndReplays) {
  LiveCell cell;
  cell.StartDaemon();
  const auto live = cell.Scan(cell.Bend(), 1, "committed");
  ASSERT_TRUE(live);
  const std::string tar = (cell.scratch() / "bundle.tar.gz").string();
  const std::string log = (cell.scratch() / "bendloopd.log").string();
  const Ran bundled = cell.scratch().Bendloop("support-bundle --config " + cell.cell_file() +
                                              " --log " + log + " --out " + tar);
  EXPECT_EQ(bundled.code, 0) << bundled.err;
  EXPECT_THAT(bundled.err, Not(HasSubstr("not in it")));
  cell.StopDaemon();
  // Elsewhere: nothing of the cell is there.
  const Ran replayed = cell.scratch().Bendloop("replay " + tar + " --json -");
  const auto result = host::ReadResultJson(replayed.out, "replay");
  ASSERT_TRUE(result) << replayed.out << replayed.err;
  EXPECT_THAT(replayed.err, Not(HasSubstr("recorded with other settings")));
  EXPECT_EQ(result->session, "part-0001");
  EXPECT_EQ(result->bender->outcome, host::CommitOutcome::kCommitted);
  EXPECT_EQ(host::WriteResultJson(*result, {.timing = false}),
            host::WriteResultJson(*live, {.timing = false}));
  EXPECT_EQ(cell.bender().commits_accepted(), 1u);
  // The doctor was asked of the installed service and of this cell, too.
  const fs::path unpacked = cell.scratch() / "unpacked";
  ASSERT_TRUE(host::Unpack(tar, unpacked, 1u << 30));
  const auto doctor = host::Json::parse(Slurp(unpacked / "doctor.json"));
  std::set<std::string> asked;
  for (const auto& finding : doctor.at("findings")) asked.insert(finding.at("name"));
  EXPECT_THAT(asked, ::testing::IsSupersetOf({"kernel", "service", "unit and rules",
                                              "user and group", "bender", "state directory"}));
  EXPECT_EQ(cell.scratch().Bendloop("replay " + tar + " --recording part-0009").code, 3);
  EXPECT_EQ(cell.scratch().Bendloop("replay " + tar + " --send").code, 2);
}

// A file system of its own for the state directory, that can be filled.
class SmallDisk {
 public:
  SmallDisk(fs::path at, const char* options) : at_(std::move(at)) {
    fs::create_directories(at_);
    is_mounted_ = ::mount("tmpfs", at_.c_str(), "tmpfs", 0, options) == 0;
  }
  ~SmallDisk() {
    if (is_mounted_) ::umount2(at_.c_str(), MNT_DETACH);
  }
  bool is_mounted() const { return is_mounted_; }
  // To the last byte, or the last file.
  void FillBytes() const {
    std::ofstream filler(at_ / "filler", std::ios::binary);
    const std::string piece(4096, 'x');
    while (filler.write(piece.data(), 4096).flush()) {
    }
  }
  void FillNames() const {
    fs::create_directories(at_ / "filler");
    for (int i = 0; std::ofstream(at_ / "filler" / std::to_string(i)); ++i) {
    }
  }
  void Free() const { fs::remove_all(at_ / "filler"); }

 private:
  fs::path at_;
  bool is_mounted_ = false;
};

// Told while it lasts, and over by itself when the disk takes something again.
void ExpectSurvived(LiveCell& cell, const SmallDisk& disk, void (SmallDisk::*fill)() const,
                    const std::vector<std::string>& alarms) {
  cell.StartDaemon();
  cell.Scan(cell.Bend(), 1, "committed");
  const auto tube = cell.Bend();
  (disk.*fill)();
  cell.Trigger(tube);
  for (const std::string& alarm : alarms) ASSERT_TRUE(cell.HasAlarm(alarm)) << cell.log();
  ASSERT_TRUE(cell.Becomes("/state", "waiting for a scan")) << cell.log();
  disk.Free();
  // With nobody at work: what was at hand is written, and is no alarm any more.
  for (const char* kept : {"BL5001", "BL5002", "BL5003", "BL5006"}) {
    if (std::find(alarms.begin(), alarms.end(), kept) == alarms.end()) continue;
    ASSERT_TRUE(cell.LosesAlarm(kept)) << kept << cell.log();
  }
  EXPECT_TRUE(cell.Result(2));
  cell.Scan(cell.Bend(), 3, "committed");
  cell.Scan(cell.Bend(), 4,
            "");  // the recording of the second was known to lack after it was judged
  for (const std::string& alarm : alarms) {
    ASSERT_TRUE(cell.HasAlarm(alarm, "alarms_ended")) << alarm << cell.log();
  }
  cell.StopDaemon();
  const auto history = host::History::Open(cell.scratch() / "state/history.db");
  ASSERT_TRUE(history) << history.error().message;
  EXPECT_EQ(history->Last(1)->front().result.session, "part-0004");
  for (const char* session : {"part-0001", "part-0002", "part-0003"}) {
    EXPECT_TRUE(history->Has(session).value_or(false)) << session;
  }
}

TEST(Appliance, AFullDiskIsToldAndSurvived) {
  LiveCell cell("[storage]\nmin_free_mb = 0\nreport_every_parts = 0\n");
  const SmallDisk disk(cell.scratch() / "state", "size=24m");
  if (!disk.is_mounted()) GTEST_SKIP() << "mounting a file system needs root";
  ExpectSurvived(cell, disk, &SmallDisk::FillBytes, {"BL5001"});
}

// Also of a scanner that is not there, and with no part before, between or after.
TEST(Appliance, ADiskThatFillsWithNobodyAtWorkIsToldAndOverByItself) {
  LiveCell cell("[storage]\nreport_every_parts = 0\n");
  const SmallDisk disk(cell.scratch() / "state", "size=400m,nr_inodes=400");
  if (!disk.is_mounted()) GTEST_SKIP() << "mounting a file system needs root";
  cell.StartDaemon();
  disk.FillNames();
  ASSERT_TRUE(cell.HasAlarm("BL5006")) << cell.log();
  disk.Free();
  ASSERT_TRUE(cell.HasAlarm("BL5006", "alarms_ended")) << cell.log();
  cell.StopScanner();
  ASSERT_TRUE(cell.HasAlarm("BL1001")) << cell.log();
  disk.FillNames();
  ASSERT_TRUE(cell.HasAlarm("BL5006")) << cell.log();
  disk.Free();
  ASSERT_TRUE(cell.LosesAlarm("BL5006")) << cell.log();
  cell.StopDaemon();
}

TEST(Appliance, ADiskWithoutInodesIsToldAndSurvived) {
  LiveCell cell("[storage]\nreport_every_parts = 0\n");
  const SmallDisk disk(cell.scratch() / "state", "size=400m,nr_inodes=400");
  if (!disk.is_mounted()) GTEST_SKIP() << "mounting a file system needs root";
  ExpectSurvived(cell, disk, &SmallDisk::FillNames, {"BL5001", "BL5005", "BL5006"});
}

TEST(Appliance, ADeadScannerIsToldAndFoundAgain) {
  LiveCell cell;
  cell.StartDaemon();
  cell.RestartScanner();
  ASSERT_TRUE(cell.HasAlarm("BL1001", "alarms_ended")) << cell.log();
  cell.Scan(cell.Bend(), 1, "committed");
  cell.StopDaemon();
}

// One that somebody forgot to switch off: it says neither where a scan begins nor where it ends.
TEST(Appliance, AScannerThatStreamsOnIsToldAndBringsOneScanAtMost) {
  LiveCell cell("[scan]\nend = \"coverage\"\nmax_seconds = 3\nsilence_seconds = 1\n");
  cell.StartDaemon();
  // A third of a tube again and again, which never covers the part; 3000 profiles are 3 s of it.
  const std::size_t profiles = cell.Sweep(cell.Bend(), 20, 6);
  ASSERT_GT(profiles, 10'000u);
  ASSERT_TRUE(cell.HasAlarm("BL1003")) << cell.log();
  ASSERT_TRUE(cell.Becomes("/parts/failed_scans", 1)) << cell.log();
  ASSERT_TRUE(cell.Until([&] { return cell.ScansFinished() == 1; })) << cell.log();
  EXPECT_TRUE(cell.HasAlarm("BL1003"));
  EXPECT_THAT(Slurp(cell.scratch() / "state/results/part-0001.json"),
              HasSubstr("the scan runs for more than 3 s"));
  EXPECT_EQ(cell.results(), 1u);
  auto session = drivers::SessionReader::Open(cell.scratch() / "state/sessions/part-0001.session");
  ASSERT_TRUE(session) << session.error().message;
  hal::LaserProfile profile;
  while (session->NextProfile(profile).value_or(false)) {
  }
  EXPECT_LE(session->profiles_read(), 3002u);
  // Switched off at last: nobody has to do anything, the next tube is measured and corrected.
  cell.AwaitSilence(std::chrono::seconds(2));
  cell.Sweep(cell.Bend(), 1);
  EXPECT_TRUE(cell.Result(2, "committed"));
  ASSERT_TRUE(cell.HasAlarm("BL1003", "alarms_ended")) << cell.log();
  cell.StopDaemon();
}

TEST(Appliance, NoNameComesTwiceWhateverIsRemoved) {
  LiveCell cell;
  cell.StartDaemon();
  cell.Scan(cell.Bend(), 1, "committed");
  cell.StopDaemon();
  // Only the history knows of it still.
  fs::remove_all(cell.scratch() / "state/results");
  fs::remove_all(cell.scratch() / "state/sessions");
  fs::remove(cell.scratch() / "state/journal.db");
  cell.StartDaemon();
  cell.Trigger(cell.Bend());
  EXPECT_TRUE(cell.Result(2));
  cell.StopDaemon();
}

}  // namespace
}  // namespace bendloop::testing
