// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/history/history_search.h"

#include <gmock/gmock.h>
#include <unistd.h>

#include <algorithm>

#include "firmware-host/history/history.h"
#include "firmware-host/history/history_output.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/result/json.h"
#include "tests/support/sample_run.h"

namespace bendloop::host {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

// Ten parts, one a day from 2026-03-01; every second is an elbow, the first five are of lot 1.
class HistorySearch : public testing::Test {
 protected:
  HistorySearch() {
    std::string name = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(name.data());
    writer_.emplace(std::move(*History::Open(path())));
    for (int i = 0; i < 10; ++i) {
      RunResult run = SampleRun(i, 0.1, 10);
      run.session = "part-00" + std::to_string(10 + i);
      run.part = i % 2 == 0 ? "elbow" : "a \"name\", with\ncommas";
      run.time =
          "2026-03-" + std::string(i < 9 ? "0" : "") + std::to_string(i + 1) + "T06:30:00.000Z";
      EXPECT_TRUE(writer_->Add(run, i < 5 ? 1 : 2));
    }
  }
  ~HistorySearch() override { std::filesystem::remove_all(folder_); }
  std::filesystem::path path() const { return folder_ / "history.db"; }

  std::vector<HistoryRow> Rows(const HistoryFilter& filter = {}) const {
    const auto reader = HistoryReader::Open(path());
    EXPECT_TRUE(reader) << reader.error().message;
    std::vector<HistoryRow> rows;
    EXPECT_TRUE(reader->Each(filter, [&](const HistoryRow& row) { rows.push_back(row); }));
    return rows;
  }
  std::vector<std::string> Days(const HistoryFilter& filter) const {
    std::vector<std::string> days;
    for (const HistoryRow& row : Rows(filter)) days.push_back(row.time.substr(8, 2));
    return days;
  }

  std::filesystem::path folder_;
  std::optional<History> writer_;  // open all the time, as the daemon's
};

TEST_F(HistorySearch, FindsWhatIsAskedForOldestFirst) {
  EXPECT_EQ(Rows().size(), 10u);
  EXPECT_THAT(Days({.part = "elbow", .lot = 1}), ElementsAre("01", "03", "05"));
  EXPECT_THAT(Days({.since = "2026-03-09"}), ElementsAre("09", "10"));
  EXPECT_THAT(Days({.until = "2026-03-02"}), ElementsAre("01", "02"));
  EXPECT_THAT(Days({.since = "2026-03-02T07", .until = "2026-03-04T06"}), ElementsAre("03", "04"));
  EXPECT_THAT(Days({.most = 2}), ElementsAre("09", "10"));
  EXPECT_THAT(Days({.session = "part-0013"}), ElementsAre("04"));
  const std::string verdict = Rows().front().verdict;
  EXPECT_EQ(Rows({.verdict = verdict}).size(), 10u);
  EXPECT_TRUE(Rows({.verdict = "none"}).empty());
  EXPECT_TRUE(Rows({.part = "elbow' OR '1'='1"}).empty());
}

TEST_F(HistorySearch, ReadsWhileSomebodyWritesAndWritesNothing) {
  const auto before = std::filesystem::last_write_time(path());
  const auto reader = HistoryReader::Open(path());
  ASSERT_TRUE(reader) << reader.error().message;
  std::size_t rows = 0;
  EXPECT_TRUE(reader->Each({}, [&](const HistoryRow&) {
    if (rows++ == 0) {
      EXPECT_TRUE(writer_->Add(SampleRun()));
    }
  }));
  EXPECT_EQ(rows, 10u);
  EXPECT_EQ(Rows().size(), 11u);
  EXPECT_EQ(std::filesystem::last_write_time(path()), before);  // the writer's log has it
}

TEST_F(HistorySearch, WithoutAHistoryItSaysSo) {
  const auto none = HistoryReader::Open(folder_ / "none" / "history.db");
  ASSERT_FALSE(none);
  EXPECT_THAT(none.error().message, HasSubstr("there is no history"));
}

TEST_F(HistorySearch, TablesLineUpAndExportsAreWhole) {
  const auto rows = Rows();
  const std::string text = HistoryText(rows, false);
  EXPECT_THAT(text, HasSubstr("part-0010  2026-03-01T06:30:00  elbow"));
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 12);  // two of titles
  const std::string csv = HistoryCsv(rows);
  EXPECT_THAT(csv, HasSubstr("session,time,part,lot,verdict,worst_percent,"));
  EXPECT_THAT(csv, HasSubstr("\npart-0010,2026-03-01T06:30:00.000Z,elbow,1,"));
  EXPECT_THAT(csv, HasSubstr(",\"a \"\"name\"\", with\ncommas\",1,"));
  const std::string values = HistoryValuesCsv(rows);
  EXPECT_THAT(values, HasSubstr(",2,angle_deg,"));
  const Json json = Json::parse(HistoryJson(rows));
  EXPECT_EQ(json.at("schema"), "bendloop.history/1");
  EXPECT_EQ(json.at("parts").size(), 10u);
  EXPECT_EQ(json.at("parts")[9].at("lot"), 2);
  EXPECT_EQ(json.at("parts")[9].at("result").at("session"), "part-0019");
}

TEST_F(HistorySearch, ADamagedRowIsListedWithoutItsValues) {
  std::vector<HistoryRow> rows = Rows();
  rows.front().result = "{\"inspection\": {\"rows\": [7, {\"length_mm\": 3}]}";
  rows.back().result = "{\"inspection\": {\"rows\": [7, {\"length_mm\": 3}]}, \"identity\": \"x\"}";
  EXPECT_THAT(HistoryText(rows, false), HasSubstr("part-0010"));
  EXPECT_THAT(HistoryCsv(rows), HasSubstr(",x\n"));
  HistoryValuesCsv(rows);
  HistoryJson(rows);
}

TEST(HistoryTimes, AreUtcOrSoLongAgo) {
  const std::int64_t now_ms = *ParseUtc("2026-11-22T14:53:00.000Z");
  EXPECT_EQ(HistoryTime("2026-11-22T06", now_ms, "--since").value(), "2026-11-22T06");
  EXPECT_EQ(HistoryTime("", now_ms, "--since").value(), "");
  EXPECT_EQ(HistoryTime("8h", now_ms, "--since").value(), "2026-11-22T06:53:00.000Z");
  EXPECT_EQ(HistoryTime("7d", now_ms, "--since").value(), "2026-11-15T14:53:00.000Z");
  for (const char* wrong : {"yesterday", "22.11.2026", "h", "-3h", "9999999999d", "2026-1", "20"}) {
    const auto read = HistoryTime(wrong, now_ms, "--since");
    ASSERT_FALSE(read) << wrong;
    EXPECT_EQ(read.error().kind, hal::ErrorKind::kUsage);
    EXPECT_THAT(read.error().message, HasSubstr("--since: found '"));
  }
}

}  // namespace
}  // namespace bendloop::host
