// SPDX-License-Identifier: Apache-2.0
#include <sys/resource.h>

#include <csignal>

#include "drivers/session/session_check.h"
#include "session_fixture.h"

namespace bendloop::drivers {
namespace {

TEST_F(SessionTest, GivesBackEveryBit) {
  std::mt19937_64 engine(1);
  std::vector<hal::LaserProfile> written;
  const hal::ManualClock clock;
  auto writer = SessionWriter::Create(Path("a.session"), clock);
  ASSERT_TRUE(writer) << writer.error().message;
  ASSERT_TRUE(writer->SetMeta({{"part", "elbow \xc3\xa9"}, {"scanner", "arm 7"}}));
  for (std::uint64_t i = 0; i < 40; ++i) {
    written.push_back(RandomProfile(engine, 3 * i, engine() % 200));
    if (i % 3 == 0) written.back().intensity.clear();
    if (i == 5) written.back().points.clear(), written.back().intensity.clear();
    const auto done = writer->Write(written.back());
    ASSERT_TRUE(done) << done.error().message;
  }
  ASSERT_TRUE(writer->Write(Event(hal::ScanEventKind::kButton, -3, "trigger")));
  ASSERT_TRUE(writer->Finish());
  EXPECT_EQ(Files(), std::set<std::string>{"a.session"});

  auto reader = SessionReader::Open(Path("a.session"));
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->meta().at("part"), "elbow \xc3\xa9");
  EXPECT_EQ(reader->meta().at("units"), "mm");
  std::size_t most = 0;
  hal::LaserProfile profile;
  for (const auto& expected : written) {
    const auto taken = reader->NextProfile(profile);
    ASSERT_TRUE(taken && *taken);
    EXPECT_TRUE(SameBits(profile, expected)) << "sequence " << expected.sequence;
    most = std::max(most, expected.points.size());
  }
  EXPECT_EQ(reader->max_points(), most);
  EXPECT_FALSE(*reader->NextProfile(profile));
  hal::ScanEvent event;
  ASSERT_TRUE(*reader->NextEvent(event));
  EXPECT_EQ(event.kind, hal::ScanEventKind::kButton);
  EXPECT_EQ(event.t_ns, -3);
  EXPECT_EQ(event.detail(), "trigger");
  EXPECT_FALSE(*reader->NextEvent(event));
  EXPECT_EQ(Files(), std::set<std::string>{"a.session"});
}

// No file may become longer than this while it lives, as on a disk that is full.
class FullDisk {
 public:
  explicit FullDisk(rlim_t most_bytes) : signal_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit full{most_bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &full);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  void (*signal_)(int);
  rlimit before_{};
};

TEST_F(SessionTest, WhatADiskHasNoRoomToBeginLeavesNoFile) {
  const hal::ManualClock clock;
  for (const rlim_t room : {0U, 1000U, 20'000U}) {
    const FullDisk full(room);
    EXPECT_FALSE(SessionWriter::Create(Path("a.session"), clock)) << room;
    EXPECT_EQ(Files(), std::set<std::string>{}) << room;
  }
  EXPECT_TRUE(SessionWriter::Create(Path("a.session"), clock));
}

TEST_F(SessionTest, CommitsWhenTheCallersClockSaysSo) {
  std::mt19937_64 engine(2);
  hal::ManualClock clock;
  auto writer = SessionWriter::Create(Path("a.session"), clock);
  ASSERT_TRUE(writer);
  const auto committed = [&] {
    auto reader = SessionReader::Open(Path("a.session"));
    hal::LaserProfile profile;
    std::size_t count = 0;
    while (*reader->NextProfile(profile)) ++count;
    return count;
  };
  ASSERT_TRUE(writer->Write(RandomProfile(engine, 0, 5)));
  clock.Advance(std::chrono::milliseconds(999));
  ASSERT_TRUE(writer->Write(RandomProfile(engine, 1, 5)));
  EXPECT_EQ(committed(), 0u);
  clock.Advance(std::chrono::milliseconds(1));
  ASSERT_TRUE(writer->Tick());
  EXPECT_EQ(committed(), 2u);
  for (std::uint64_t i = 2; i < 1002; ++i) ASSERT_TRUE(writer->Write(RandomProfile(engine, i, 1)));
  EXPECT_EQ(committed(), 1002u);
}

TEST_F(SessionTest, RefusesToWriteWhatNobodyCouldRead) {
  std::mt19937_64 engine(3);
  const hal::ManualClock clock;
  auto writer = SessionWriter::Create(Path("a.session"), clock);
  ASSERT_TRUE(writer);
  auto good = RandomProfile(engine, 5, 4);
  ASSERT_TRUE(writer->Write(good));
  EXPECT_FALSE(writer->Write(good));  // the sequence again
  auto bad = RandomProfile(engine, 6, 4);
  bad.points[2].z_mm = std::nanf("");
  const auto refused = writer->Write(bad);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("seq 6: point 2"), std::string::npos);
  bad = RandomProfile(engine, 7, 4);
  bad.X_WS.orientation.w() += 0.01;
  EXPECT_FALSE(writer->Write(bad));
  bad = RandomProfile(engine, 8, 4);
  bad.intensity.pop_back();
  EXPECT_FALSE(writer->Write(bad));
  bad = RandomProfile(engine, std::uint64_t{1} << 63U, 4);
  EXPECT_FALSE(writer->Write(bad));
  EXPECT_TRUE(writer->Write(RandomProfile(engine, 9, 4)));
  ASSERT_TRUE(writer->Finish());
  EXPECT_FALSE(writer->Write(RandomProfile(engine, 10, 4)));
  EXPECT_EQ(writer->profiles(), 2u);
}

TEST_F(SessionTest, RecordsOverNothingUnlessAsked) {
  const hal::ManualClock clock;
  ASSERT_TRUE(SessionWriter::Create(Path("a.session"), clock));
  EXPECT_FALSE(SessionWriter::Create(Path("a.session"), clock));
  EXPECT_TRUE(SessionWriter::Create(Path("a.session"), clock, {.replace = true}));
  EXPECT_FALSE(SessionWriter::Create(Path("no/such/folder/a.session"), clock));
  EXPECT_FALSE(SessionWriter::Create(folder_.string(), clock, {.replace = true}));
}

// Power loss at any moment: the file and any beginning of the log are a session that holds the
// first profiles, whole.
TEST_F(SessionTest, SurvivesPowerLossAtAnyByte) {
  std::mt19937_64 engine(4);
  hal::ManualClock clock;
  std::vector<hal::LaserProfile> written;
  auto writer = SessionWriter::Create(Path("live.session"), clock, {.commit_profiles = 3});
  ASSERT_TRUE(writer);
  for (std::uint64_t i = 0; i < 30; ++i) {
    written.push_back(RandomProfile(engine, i, 100));
    ASSERT_TRUE(writer->Write(written.back()));
  }
  const auto log_bytes = std::filesystem::file_size(Path("live.session-wal"));
  ASSERT_GT(log_bytes, 100'000u);
  std::filesystem::create_directory(Path("cut"));
  std::size_t before = 0;
  for (int cut = 0; cut <= 60; ++cut) {
    for (const char* suffix : {"", "-wal"}) {
      std::filesystem::copy_file(Path("live.session") + suffix, Path("cut/a.session") + suffix,
                                 std::filesystem::copy_options::overwrite_existing);
    }
    std::filesystem::resize_file(Path("cut/a.session-wal"), log_bytes * cut / 60);
    auto reader = SessionReader::Open(Path("cut/a.session"));
    ASSERT_TRUE(reader) << reader.error().message;
    hal::LaserProfile profile;
    std::size_t count = 0;
    while (true) {
      const auto taken = reader->NextProfile(profile);
      ASSERT_TRUE(taken) << taken.error().message;
      if (!*taken) break;
      ASSERT_LT(count, written.size());
      EXPECT_TRUE(SameBits(profile, written[count++]));
    }
    EXPECT_GE(count, before);
    before = count;
    EXPECT_FALSE(std::filesystem::exists(Path("cut/a.session-shm")));
  }
  EXPECT_EQ(before, 30u);
}

TEST_F(SessionTest, OpensWhatAnotherProgramWrote) {
  const std::string path = Path("a b?%#.session");
  // Another column order, one more table, rollback mode.
  Sql(path,
      "PRAGMA application_id=0x424C5345; PRAGMA user_version=1;"
      "CREATE TABLE notes(x); CREATE TABLE meta(value TEXT NOT NULL, key TEXT PRIMARY KEY);"
      "CREATE TABLE event(kind TEXT NOT NULL, t_ns INTEGER NOT NULL, detail TEXT);"
      "CREATE TABLE profile(seq INTEGER PRIMARY KEY, t_ns INTEGER NOT NULL, pose BLOB NOT NULL,"
      " points BLOB NOT NULL, intensity BLOB);"
      "INSERT INTO event VALUES('warm up', 5, 'slow');"
      // Position 0 0 0, orientation 1 0 0 0; one point (0, 1).
      "INSERT INTO profile VALUES(7, 9, zeroblob(24) || x'000000000000f03f' || zeroblob(24),"
      " x'000000000000803f', x'0102')");
  // || makes text of blobs, which the reader must say.
  auto reader = SessionReader::Open(path);
  ASSERT_TRUE(reader) << reader.error().message;
  hal::LaserProfile profile;
  auto taken = reader->NextProfile(profile);
  ASSERT_FALSE(taken);
  EXPECT_NE(taken.error().message.find("seq 7: pose is text"), std::string::npos)
      << taken.error().message;
  reader = hal::Fail({});
  Sql(path, "UPDATE profile SET pose = CAST(pose AS BLOB)");
  reader = SessionReader::Open(path);
  taken = reader->NextProfile(profile);
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_EQ(profile.points.at(0).z_mm, 1.0F);
  EXPECT_TRUE(profile.intensity.empty());
  EXPECT_EQ(reader->intensities_ignored(), 1u);
  hal::ScanEvent event;
  ASSERT_TRUE(*reader->NextEvent(event));
  EXPECT_EQ(event.kind, hal::ScanEventKind::kOther);
  EXPECT_EQ(event.detail(), "warm up: slow");
}

TEST_F(SessionTest, PointsThatTheScannerMissedAreLeftOutAndCounted) {
  const hal::ManualClock clock;
  const std::string path = Path("holes.session");
  auto writer = SessionWriter::Create(path, clock, {});
  std::mt19937_64 engine(5);
  for (std::uint64_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(writer->Write(RandomProfile(engine, i, 3)));
  }
  ASSERT_TRUE(writer->Finish());
  // (NaN, 1), (2, 1), (1, infinity); intensities 1, 2, 3.
  Sql(path, kWithoutSums);
  Sql(path,
      "UPDATE profile SET points = x'0000c07f0000803f000000400000803f0000803f0000807f',"
      " intensity = x'010203' WHERE seq = 1");
  auto reader = SessionReader::Open(path);
  ASSERT_TRUE(reader) << reader.error().message;
  hal::LaserProfile profile;
  ASSERT_TRUE(*reader->NextProfile(profile));
  EXPECT_EQ(reader->points_left_out(), 0u);
  const auto taken = reader->NextProfile(profile);
  ASSERT_TRUE(taken) << taken.error().message;
  ASSERT_EQ(profile.points.size(), 1u);
  EXPECT_EQ(profile.points[0].x_mm, 2.0F);
  EXPECT_EQ(profile.intensity, std::vector<std::uint8_t>{2});
  EXPECT_EQ(reader->points_left_out(), 2u);
  const auto summary = CheckSession(path);
  ASSERT_TRUE(summary && summary->ok());
  EXPECT_NE(summary->warnings.at(0).find("2 of 6 points are not finite"), std::string::npos);
}

}  // namespace
}  // namespace bendloop::drivers
