// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_source.h"

#include <limits>

#include "session_fixture.h"

namespace bendloop::drivers {
namespace {

using hal::ReadStatus;
using hal::ScanEventKind;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

class SessionSourceTest : public SessionTest {
 protected:
  // Profiles at 10, 20, 30 ms; events before, at the same time, and after them.
  std::string Record() {
    const hal::ManualClock clock;
    std::mt19937_64 engine(8);
    auto writer = SessionWriter::Create(Path("a.session"), clock);
    EXPECT_TRUE(writer->SetMeta("scanner", "arm"));
    for (const std::int64_t i : {1, 2, 3}) {
      auto profile = RandomProfile(engine, static_cast<std::uint64_t>(i), 4);
      profile.t_ns = i * 10'000'000;
      EXPECT_TRUE(writer->Write(profile));
    }
    EXPECT_TRUE(writer->Write(Event(ScanEventKind::kScanEnd, 30'000'000)));
    EXPECT_TRUE(writer->Write(Event(ScanEventKind::kScanStart, 10'000'000)));
    EXPECT_TRUE(writer->Write(Event(ScanEventKind::kGap, 20'000'000)));
    EXPECT_TRUE(writer->Write(Event(ScanEventKind::kButton, 25'000'000)));
    EXPECT_TRUE(writer->Finish());
    return Path("a.session");
  }
  hal::LaserProfile profile_;
  hal::ScanEvent event_;
  hal::ManualClock clock_;
};

TEST_F(SessionSourceTest, InterleavesEventsByTime) {
  SessionSource source(Record(), ReplayPace::kMax, clock_);
  for (int round = 0; round < 2; ++round) {
    const auto info = source.Open();
    ASSERT_TRUE(info) << info.error().message;
    EXPECT_FALSE(info->is_live);
    EXPECT_EQ(info->model, "arm");
    EXPECT_EQ(info->max_points, 4u);
    ASSERT_TRUE(source.Start());
    std::string order;
    while (true) {
      const auto status = source.Read(profile_, event_, nanoseconds(0));
      ASSERT_TRUE(status);
      if (*status == ReadStatus::kEnd) break;
      order += *status == ReadStatus::kProfile ? std::to_string(profile_.sequence)
                                               : std::string(hal::Name(event_.kind));
      order += ' ';
    }
    EXPECT_EQ(order, "scan_start 1 gap 2 button 3 scan_end ");
    EXPECT_EQ(*source.Read(profile_, event_, nanoseconds(0)), ReadStatus::kEnd);
  }
  EXPECT_EQ(clock_.Now(), nanoseconds(0));
}

TEST_F(SessionSourceTest, KeepsTheRecordedPace) {
  clock_.Advance(std::chrono::hours(1));
  const nanoseconds start = clock_.Now();
  SessionSource source(Record(), ReplayPace::kRecorded, clock_);
  ASSERT_TRUE(source.Open());
  ASSERT_TRUE(source.Start());
  int timeouts = 0;
  while (true) {
    const auto status = source.Read(profile_, event_, milliseconds(3));
    ASSERT_TRUE(status);
    if (*status == ReadStatus::kEnd) break;
    if (*status == ReadStatus::kTimeout) {
      ++timeouts;
      continue;
    }
    const std::int64_t t_ns = *status == ReadStatus::kProfile ? profile_.t_ns : event_.t_ns;
    EXPECT_EQ((clock_.Now() - start).count(), t_ns - 10'000'000);
  }
  EXPECT_EQ(timeouts, 3 + 1 + 1);
}

TEST_F(SessionSourceTest, SurvivesLyingTimes) {
  const std::string path = Record();
  Sql(path, kWithoutSums);
  Sql(path,
      "UPDATE profile SET t_ns=-9223372036854775808 WHERE seq=1;"
      "UPDATE profile SET t_ns=9223372036854775807 WHERE seq=3");
  SessionSource source(path, ReplayPace::kRecorded, clock_);
  ASSERT_TRUE(source.Open());
  ASSERT_TRUE(source.Start());
  EXPECT_EQ(*source.Read(profile_, event_, milliseconds(3)), ReadStatus::kProfile);
  EXPECT_EQ(*source.Read(profile_, event_, milliseconds(3)), ReadStatus::kTimeout);
}

TEST_F(SessionSourceTest, ErrorsAreFinal) {
  const std::string path = Record();
  Sql(path, kWithoutSums);
  Sql(path, "UPDATE profile SET points=x'00' WHERE seq=2; DELETE FROM event");
  SessionSource source(path, ReplayPace::kMax, clock_);
  EXPECT_FALSE(source.Read(profile_, event_, nanoseconds(0)));
  ASSERT_TRUE(source.Open());
  EXPECT_EQ(*source.Read(profile_, event_, nanoseconds(0)), ReadStatus::kProfile);
  const auto failed = source.Read(profile_, event_, nanoseconds(0));
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().kind, hal::ErrorKind::kBadInput);
  const auto again = source.Read(profile_, event_, nanoseconds(0));
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().message, failed.error().message);
}

}  // namespace
}  // namespace bendloop::drivers
