// SPDX-License-Identifier: Apache-2.0
#include <fstream>
#include <iterator>

#include "drivers/session/session_check.h"
#include "drivers/session/session_source.h"
#include "session_fixture.h"

namespace bendloop::drivers {
namespace {

using ::testing::Test;

class DamagedSessionTest : public SessionTest {
 protected:
  // A good session of 20 profiles with 30 points each.
  std::string Good(std::size_t points = 30) {
    std::mt19937_64 engine(5);
    const hal::ManualClock clock;
    auto writer = SessionWriter::Create(Path("a.session"), clock, {.replace = true});
    for (std::uint64_t i = 0; i < 20; ++i) {
      EXPECT_TRUE(writer->Write(RandomProfile(engine, i, points)));
    }
    EXPECT_TRUE(writer->Write(Event(hal::ScanEventKind::kScanEnd, 1, "done")));
    EXPECT_TRUE(writer->Finish());
    return Path("a.session");
  }
  static std::string FirstError(const std::string& path) {
    auto reader = SessionReader::Open(path);
    if (!reader) return reader.error().message;
    hal::LaserProfile profile;
    while (true) {
      const auto taken = reader->NextProfile(profile);
      if (!taken) return taken.error().message;
      if (!*taken) break;
    }
    hal::ScanEvent event;
    const auto taken = reader->NextEvent(event);
    return taken ? "" : taken.error().message;
  }
  void ExpectError(const std::string& sql, const std::string& words) {
    const std::string path = Good();
    Sql(path, sql);
    const std::string message = FirstError(path);
    EXPECT_NE(message.find(words), std::string::npos) << "after " << sql << ": " << message;
    EXPECT_EQ(message.rfind(path, 0), 0u) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos);
    const auto summary = CheckSession(path);
    EXPECT_TRUE(!summary || !summary->ok()) << sql;
  }
};

TEST_F(DamagedSessionTest, SaysWhatIsWrongAndWhere) {
  ExpectError("PRAGMA application_id=1", "application_id is 0x00000001, expected 0x424C5345");
  ExpectError("PRAGMA user_version=3", "user_version is 3, expected 1 or 2");
  ExpectError("DROP TABLE event", "table event: missing");
  ExpectError("DROP TABLE event; CREATE VIEW event AS SELECT 1 t_ns, 2 kind, 3 detail",
              "table event: missing");
  ExpectError("ALTER TABLE profile RENAME COLUMN pose TO poze",
              "table profile: columns are (seq, t_ns, poze, points, intensity, crc), expected");
  ExpectError("UPDATE meta SET value='m' WHERE key='units'", "key units: found \"m\"");
  ExpectError("UPDATE profile SET pose=zeroblob(48) WHERE seq=3",
              "table profile, seq 3: pose has 48 bytes, expected 56");
  ExpectError("UPDATE profile SET pose=zeroblob(56) WHERE seq=3",
              "seq 3: pose, byte 24: the quaternion has length 0");
  ExpectError("UPDATE profile SET points=zeroblob(13) WHERE seq=4",
              "seq 4: points has 13 bytes, expected a multiple of 8");
  ExpectError("UPDATE profile SET pose=CAST(x'000000000000f87f' || zeroblob(48) AS BLOB)",
              "seq 0: pose, byte 0: not a finite number");
  ExpectError("UPDATE profile SET points='12345678' WHERE seq=4", "seq 4: points is text");
  ExpectError("UPDATE profile SET points=zeroblob(8000008) WHERE seq=4", "1000001 points");
  ExpectError("UPDATE profile SET points=zeroblob(30000000) WHERE seq=4", "more than 16777216");
  ExpectError("UPDATE profile SET t_ns='soon' WHERE seq=4", "seq 4: t_ns is text");
  ExpectError("UPDATE profile SET seq=-1 WHERE seq=4", "a negative seq");
  ExpectError("UPDATE event SET t_ns='soon'", "table event, row 1: t_ns is text");
}

TEST_F(DamagedSessionTest, RefusesWhatIsNoSession) {
  EXPECT_NE(FirstError(Path("none")).find("cannot open"), std::string::npos);
  EXPECT_NE(FirstError(folder_.string()).find("not a regular file"), std::string::npos);
  std::ofstream(Path("empty")).close();
  EXPECT_NE(FirstError(Path("empty")).find("0 bytes"), std::string::npos);
  std::ofstream(Path("text")) << std::string(500, 'x');
  EXPECT_NE(FirstError(Path("text")).find("not a SQLite database"), std::string::npos);
}

TEST_F(DamagedSessionTest, CountsWhatWasReadableBeforeTheDamage) {
  const std::string path = Good(5000);
  std::filesystem::resize_file(path, std::filesystem::file_size(path) * 2 / 3);
  const std::string message = FirstError(path);
  EXPECT_NE(message.find("damaged after 1"), std::string::npos) << message;
  EXPECT_NE(message.find(" profiles (last seq 1"), std::string::npos) << message;
  const auto summary = CheckSession(path);
  ASSERT_TRUE(summary);
  EXPECT_FALSE(summary->ok());
  EXPECT_GT(summary->profiles, 5u);
  EXPECT_LE(summary->problems.size(), 4u);  // the pages, the row, the digest
  EXPECT_NE(summary->problems[0].find(": the database is damaged, first: "), std::string::npos)
      << summary->problems[0];
}

TEST_F(DamagedSessionTest, SaysOfACutFileWhereItEndsAndTheMend) {
  const std::string path = Good(5000);
  const auto whole = std::filesystem::file_size(path);
  for (const std::uintmax_t cut :
       {std::uintmax_t{100}, std::uintmax_t{101}, std::uintmax_t{4096}, whole * 2 / 3, whole - 1}) {
    SCOPED_TRACE(cut);
    std::filesystem::copy_file(path, Path("cut"),
                               std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(Path("cut"), cut);
    const std::string mend = "the file ends after byte " + std::to_string(cut) + " of " +
                             std::to_string(whole) + ": copy it again";
    const auto summary = CheckSession(Path("cut"));
    const std::string message = summary ? summary->problems.at(0) : summary.error().message;
    EXPECT_NE(message.find(mend), std::string::npos) << message;
  }
  // As long as it should be, and no file any more.
  std::ofstream(path, std::ios::in | std::ios::out | std::ios::binary).seekp(100)
      << std::string(4000, 'x');
  const std::string message = FirstError(path);
  EXPECT_NE(message.find("; copy it again, and the log beside it (-wal)"), std::string::npos)
      << message;
}

TEST_F(DamagedSessionTest, NeverCrashesOnRandomDamage) {
  const std::string good = Good(300);
  std::string bytes(std::filesystem::file_size(good), '\0');
  std::ifstream(good, std::ios::binary)
      .read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  std::mt19937_64 engine(6);
  for (int round = 0; round < 300; ++round) {
    std::string damaged = bytes;
    const int changes = 1 + static_cast<int>(engine() % 20);
    for (int i = 0; i < changes; ++i) {
      damaged[engine() % (round % 2 == 0 ? 4000 : bytes.size())] = static_cast<char>(engine());
    }
    std::ofstream(Path("bad"), std::ios::binary) << damaged;
    (void)FirstError(Path("bad"));
    (void)CheckSession(Path("bad"));
  }
}

TEST_F(DamagedSessionTest, ChecksTheWholeFileNotOnlyTheFirstFault) {
  const std::string path = Good();
  EXPECT_TRUE(CheckSession(path)->ok());
  EXPECT_TRUE(CheckSession(path)->warnings.empty());
  Sql(path, kWithoutSums);
  EXPECT_TRUE(CheckSession(path)->ok());
  Sql(path,
      "UPDATE profile SET pose=zeroblob(5) WHERE seq IN (3, 9); DELETE FROM profile WHERE seq=5;"
      "UPDATE profile SET t_ns=0 WHERE seq=12; UPDATE profile SET intensity=x'00' WHERE seq=1");
  const auto summary = CheckSession(path);
  ASSERT_TRUE(summary);
  EXPECT_EQ(summary->problems.size(), 2u);
  EXPECT_EQ(summary->warnings.size(), 3u);
  EXPECT_EQ(summary->profiles, 17u);
  EXPECT_EQ(summary->points, 17u * 30u);
  EXPECT_EQ(summary->events, 1u);
}

// What a replay delivers of a file; the numbers of its profiles.
struct Replayed {
  std::vector<hal::LaserProfile> profiles;
  std::size_t left_out = 0;
  std::string error;
};

Replayed Replay(const std::string& path) {
  Replayed replayed;
  hal::ManualClock clock;
  SessionSource source(path, ReplayPace::kMax, clock);
  const auto info = source.Open();
  if (!info) return {{}, 0, info.error().message};
  (void)source.Start();
  hal::LaserProfile profile(info->max_points);
  hal::ScanEvent event;
  while (true) {
    const auto status = source.Read(profile, event, std::chrono::nanoseconds(0));
    if (!status) replayed.error = status.error().message;
    if (!status || *status == hal::ReadStatus::kEnd) break;
    if (*status == hal::ReadStatus::kProfile) replayed.profiles.push_back(profile);
  }
  replayed.left_out = source.profiles_left_out();
  return replayed;
}

TEST_F(DamagedSessionTest, ADamagedProfileIsLeftOutCountedAndTold) {
  const std::string path = Good();
  Sql(path, "UPDATE profile SET t_ns = t_ns + 1 WHERE seq IN (3, 9)");
  const Replayed replayed = Replay(path);
  EXPECT_EQ(replayed.error, "");
  EXPECT_EQ(replayed.left_out, 2u);
  ASSERT_EQ(replayed.profiles.size(), 18u);
  EXPECT_EQ(replayed.profiles[3].sequence, 4u);
  const auto summary = CheckSession(path);
  ASSERT_EQ(summary->problems.size(), 3u);  // the profiles, and the whole
  EXPECT_NE(summary->problems[0].find("seq 3: crc is 0x"), std::string::npos);
  EXPECT_NE(summary->problems[0].find("; the profile is damaged"), std::string::npos);
}

TEST_F(DamagedSessionTest, NobodyWaitsForTheTimeOfADamagedProfile) {
  const std::string path = Good();
  Sql(path, "UPDATE profile SET t_ns = 9223372036854775807 WHERE seq = 0");
  hal::ManualClock clock;
  SessionSource source(path, ReplayPace::kRecorded, clock);
  ASSERT_TRUE(source.Open() && source.Start());
  hal::LaserProfile profile(100);
  hal::ScanEvent event;
  std::size_t profiles = 0;
  while (true) {
    const auto status = source.Read(profile, event, std::chrono::seconds(1));
    ASSERT_TRUE(status);
    if (*status == hal::ReadStatus::kEnd) break;
    ASSERT_NE(*status, hal::ReadStatus::kTimeout);
    profiles += *status == hal::ReadStatus::kProfile ? 1 : 0;
  }
  EXPECT_EQ(profiles, 19u);
}

// Every bit counts: whatever is damaged, what comes is what was recorded, and "ok" means all of it.
TEST_F(DamagedSessionTest, NoFlippedBitChangesWhatIsReplayedUnseen) {
  const std::string good = Good(100);
  const std::vector<hal::LaserProfile> recorded = Replay(good).profiles;
  ASSERT_EQ(recorded.size(), 20u);
  std::ifstream file(good, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(file)), {});
  std::mt19937_64 engine(9);
  int seen = 0;
  for (int round = 0; round < 400; ++round) {
    std::string flipped = bytes;
    flipped[engine() % bytes.size()] ^= static_cast<char>(1U << engine() % 8);
    std::ofstream(Path("bad"), std::ios::binary) << flipped;
    const Replayed replayed = Replay(Path("bad"));
    for (const hal::LaserProfile& profile : replayed.profiles) {
      ASSERT_LT(profile.sequence, recorded.size());
      EXPECT_TRUE(SameBits(profile, recorded[profile.sequence])) << "round " << round;
    }
    const auto summary = CheckSession(Path("bad"));
    const bool ok = summary && summary->ok();
    EXPECT_TRUE(!ok || replayed.profiles.size() == recorded.size()) << "round " << round;
    seen += ok ? 0 : 1;
  }
  EXPECT_GT(seen, 40);  // the others lie where nothing is stored
}

TEST_F(DamagedSessionTest, RowsThatGoOrComeAfterwardsAreSeen) {
  for (const char* change :
       {"DELETE FROM profile WHERE seq = 19", "DELETE FROM event",
        "INSERT INTO meta VALUES('part', 'another')", "UPDATE event SET detail = 'dome'"}) {
    const std::string path = Good();
    Sql(path, change);
    const auto summary = CheckSession(path);
    ASSERT_EQ(summary->problems.size(), 1u) << change;
    EXPECT_NE(summary->problems[0].find("key digest"), std::string::npos) << change;
  }
}

TEST_F(DamagedSessionTest, ReadsFilesWithoutChecksums) {
  const std::string path = Good();
  const std::vector<hal::LaserProfile> recorded = Replay(path).profiles;
  Sql(path, kWithoutSums);
  const Replayed replayed = Replay(path);
  ASSERT_EQ(replayed.profiles.size(), recorded.size());
  for (std::size_t i = 0; i < recorded.size(); ++i) {
    EXPECT_TRUE(SameBits(replayed.profiles[i], recorded[i]));
  }
}

TEST_F(DamagedSessionTest, IsNotOkWhereNothingCanBeReplayed) {
  const std::string path = Good();
  Sql(path,
      "UPDATE profile SET t_ns = 9223372036854775807 WHERE seq = 7;" + std::string(kWithoutSums));
  auto summary = CheckSession(path);
  ASSERT_EQ(summary->problems.size(), 1u);
  EXPECT_NE(summary->problems[0].find("9223372036854775807, more than a day"), std::string::npos);
  Sql(path, "DELETE FROM profile");
  summary = CheckSession(path);
  ASSERT_EQ(summary->problems.size(), 1u);
  EXPECT_NE(summary->problems[0].find("holds no profile"), std::string::npos);
}

TEST_F(DamagedSessionTest, SaysThatARecorderWasCutOff) {
  std::mt19937_64 engine(7);
  const hal::ManualClock clock;
  auto writer = SessionWriter::Create(Path("live"), clock, {.commit_profiles = 1});
  ASSERT_TRUE(writer && writer->Write(RandomProfile(engine, 0, 3)));
  auto summary = CheckSession(Path("live"));
  EXPECT_TRUE(summary->ok());
  ASSERT_EQ(summary->warnings.size(), 1u);
  EXPECT_NE(summary->warnings[0].find("was never closed"), std::string::npos);
  EXPECT_NE(summary->warnings[0].find("keep both together"), std::string::npos);
  std::filesystem::copy_file(Path("live"), Path("alone"));
  summary = CheckSession(Path("alone"));
  EXPECT_FALSE(summary->ok());
  EXPECT_NE(summary->warnings.at(0).find("is missing"), std::string::npos);
}

// Files that arrive without their log, or whose recorder was killed in rollback mode.
TEST_F(DamagedSessionTest, OpensTheFileWithoutItsLog) {
  std::mt19937_64 engine(7);
  const hal::ManualClock clock;
  auto writer = SessionWriter::Create(Path("live"), clock, {.commit_profiles = 1});
  ASSERT_TRUE(writer && writer->Write(RandomProfile(engine, 0, 3)));
  std::filesystem::create_directory(Path("alone"));
  std::filesystem::copy_file(Path("live"), Path("alone/a?b"));
  EXPECT_EQ(FirstError(Path("alone/a?b")), "");
  EXPECT_EQ(CheckSession(Path("alone/a?b"))->profiles, 0u);
  EXPECT_FALSE(std::filesystem::exists(Path("alone/a?b-shm")));
}

}  // namespace
}  // namespace bendloop::drivers
