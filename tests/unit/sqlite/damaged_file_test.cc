// SPDX-License-Identifier: Apache-2.0
#include "drivers/sqlite/damaged_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "drivers/sqlite/database.h"
#include "drivers/sqlite/database_format.h"

namespace bendloop::drivers {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr const char* kSteps[] = {"CREATE TABLE a(x)",
                                  "CREATE TABLE b(y); INSERT INTO b VALUES(7)"};
constexpr DatabaseFormat kFormat{0x54455354, "TEST", "list of tests", kSteps};

class DamagedFile : public testing::Test {
 protected:
  DamagedFile() {
    std::string pattern = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    path_ = folder_ / "file.db";
  }
  ~DamagedFile() override { fs::remove_all(folder_); }

  Database Opened() const {
    auto database = Database::Open(path_.string(), path_.string());
    EXPECT_TRUE(database) << database.error().message;
    return std::move(*database);
  }
  void Fill() const {
    const Database database = Opened();
    EXPECT_TRUE(
        database.Execute("PRAGMA page_size=512; CREATE TABLE t(a); CREATE INDEX i ON t(a);"
                         "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n LIMIT 500)"
                         " INSERT INTO t SELECT hex(k * 7919) FROM n"));
  }
  void Overwrite(std::size_t from, std::size_t bytes) const {
    std::fstream file(path_, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(from));
    file << std::string(bytes, '\x5a');
  }

  fs::path folder_;
  fs::path path_;
};

TEST_F(DamagedFile, IsToldFromASoundOne) {
  EXPECT_EQ(DamageOf(path_), "");  // none
  Fill();
  EXPECT_EQ(DamageOf(path_), "");
  Overwrite(1024, 600);  // in the middle of a page
  EXPECT_THAT(DamageOf(path_), HasSubstr("file.db"));
  std::ofstream(path_) << "no database at all, whatever its name may say to whoever reads it .....";
  EXPECT_NE(DamageOf(path_), "");
  fs::remove(path_);
  Fill();
  fs::resize_file(path_, fs::file_size(path_) / 2);
  EXPECT_NE(DamageOf(path_), "");
  fs::resize_file(path_, 0);  // as an empty one it begins anew
  EXPECT_EQ(DamageOf(path_), "");
}

TEST_F(DamagedFile, IsMovedAsideUnderANameOfItsOwn) {
  const std::int64_t unix_ms = 1'795'359'180'123;  // 2026-11-22T14:53:00Z
  std::vector<std::string> names;
  for (int i = 0; i < 3; ++i) {
    std::ofstream(path_) << "damaged " << i;
    std::ofstream(path_.string() + "-wal") << "its log";
    const auto aside = MoveAside(path_, unix_ms);
    ASSERT_TRUE(aside) << aside.error().message;
    EXPECT_FALSE(fs::exists(path_));
    EXPECT_FALSE(fs::exists(path_.string() + "-wal"));
    EXPECT_TRUE(fs::exists(aside->string() + "-wal"));
    names.push_back(aside->filename().string());
    std::ifstream file(*aside);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}),
              "damaged " + std::to_string(i));
  }
  EXPECT_THAT(names,
              ElementsAre("file.db.damaged-20261122T145300Z", "file.db.damaged-20261122T145300Z-2",
                          "file.db.damaged-20261122T145300Z-3"));
  EXPECT_EQ(MovedAside(path_).size(), 3u);
  EXPECT_FALSE(MoveAside(path_, unix_ms));  // nothing there
}

TEST_F(DamagedFile, FormatsAreBroughtToTheNewestAndNeverBack) {
  const Database database = Opened();
  ASSERT_TRUE(
      database.Execute("CREATE TABLE a(x); PRAGMA application_id=1413829460;"
                       "PRAGMA user_version=1"));
  EXPECT_THAT(ExpectFormat(database, kFormat).error().message, HasSubstr("version 1, expected 2"));
  ASSERT_TRUE(BringToFormat(database, kFormat));
  ASSERT_TRUE(BringToFormat(database, kFormat));  // nothing twice
  ASSERT_TRUE(ExpectFormat(database, kFormat));
  EXPECT_EQ(database.Integer("SELECT sum(y) FROM b").value(), 7);
  EXPECT_EQ(database.Integer("PRAGMA user_version").value(), 2);
  ASSERT_TRUE(database.Execute("PRAGMA user_version=5"));
  const auto newer = BringToFormat(database, kFormat);
  ASSERT_FALSE(newer);
  EXPECT_EQ(newer.error().kind, hal::ErrorKind::kBadInput);
  EXPECT_THAT(newer.error().message,
              HasSubstr("version 5, and this bendloop knows versions up to 2"));
  ASSERT_TRUE(database.Execute("PRAGMA application_id=1"));
  EXPECT_THAT(BringToFormat(database, kFormat).error().message, HasSubstr("not a list of tests"));
}

// A step that fails leaves the file as it was.
TEST_F(DamagedFile, AFormatIsReachedWhollyOrNotAtAll) {
  const Database database = Opened();
  constexpr const char* kBroken[] = {"CREATE TABLE a(x)", "CREATE TABLE b(y); no SQL"};
  ASSERT_FALSE(BringToFormat(database, {1, "ONE", "broken list", kBroken}));
  EXPECT_EQ(database.Integer("SELECT count(*) FROM sqlite_master").value(), 0);
  ASSERT_TRUE(BringToFormat(database, kFormat));
}

}  // namespace
}  // namespace bendloop::drivers
