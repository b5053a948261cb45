// SPDX-License-Identifier: Apache-2.0
#include "drivers/sqlite/database.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <optional>
#include <utility>

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using testing::HasSubstr;
using Access = DatabaseOptions::Access;
using Outcome = Statement::Outcome;
using Type = Statement::Type;

class DatabaseTest : public testing::Test {
 protected:
  DatabaseTest() {
    std::string pattern = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
    path_ = (folder_ / "file.db").string();
  }
  ~DatabaseTest() override { std::filesystem::remove_all(folder_); }

  Database Opened(const DatabaseOptions& options = {}) const {
    auto database = Database::Open(path_, path_, options);
    EXPECT_TRUE(database) << database.error().message;
    return std::move(*database);
  }

  std::filesystem::path folder_;
  std::string path_;
};

TEST_F(DatabaseTest, GivesBackWhatWasBound) {
  const Database database = Opened();
  ASSERT_TRUE(database.Execute("CREATE TABLE t(a, b, c, d, e)"));
  auto insert = database.Prepare("INSERT INTO t VALUES(?, ?, ?, ?, ?)");
  ASSERT_TRUE(insert) << insert.error().message;
  const std::array<unsigned char, 3> bytes{0, 1, 255};
  for (int row = 0; row < 2; ++row) {  // a statement is ready again after Run
    insert->Bind(-7)
        .Bind(std::string_view("a\0b", 3))
        .Bind(bytes)
        .BindNull()
        .Bind(std::span<const unsigned char>());
    ASSERT_TRUE(database.Run(*insert, "cannot insert"));
    EXPECT_EQ(database.last_id(), row + 1);
  }
  auto select = database.Prepare("SELECT a, b, c, d, e FROM t");
  ASSERT_TRUE(select);
  ASSERT_EQ(select->Step(), Outcome::kRow);
  EXPECT_EQ(select->Integer(0), -7);
  EXPECT_EQ(select->Text(1), std::string_view("a\0b", 3));
  EXPECT_THAT(select->Blob(2), testing::ElementsAre(0, 1, 255));
  EXPECT_EQ(select->type(3), Type::kNull);
  EXPECT_EQ(select->Text(3), "");
  EXPECT_EQ(select->type(4), Type::kBlob);  // empty, and no NULL
  EXPECT_TRUE(select->Blob(4).empty());
  ASSERT_EQ(select->Step(), Outcome::kRow);
  EXPECT_EQ(select->Step(), Outcome::kEnd);
}

TEST_F(DatabaseTest, BindsNoNumberAsNull) {
  const Database database = Opened();
  auto select = database.Prepare("SELECT ?, ?");
  ASSERT_TRUE(select) << select.error().message;
  select->Bind(std::optional<std::int64_t>()).Bind(std::optional<std::int64_t>(7));
  ASSERT_EQ(select->Step(), Outcome::kRow);
  EXPECT_EQ(select->type(0), Type::kNull);
  EXPECT_EQ(select->Integer(1), 7);
}

TEST_F(DatabaseTest, TransactsAllOrNothing) {
  const Database database = Opened();
  ASSERT_TRUE(database.Execute("CREATE TABLE t(a UNIQUE)"));
  const auto done = database.Transact("cannot do both", [&]() -> hal::Result<void> {
    EXPECT_TRUE(database.in_transaction());
    EXPECT_TRUE(database.Execute("INSERT INTO t VALUES(1)"));
    return database.Execute("INSERT INTO t VALUES(1)");
  });
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("UNIQUE constraint failed"));
  EXPECT_FALSE(database.in_transaction());
  EXPECT_EQ(database.Integer("SELECT count(*) FROM t").value(), 0);
  EXPECT_TRUE(database.Transact("cannot", [&] { return database.Execute("DELETE FROM t"); }));
}

TEST_F(DatabaseTest, LetsNoTransactionBeginWithinAnother) {
  const Database database = Opened();
  ASSERT_TRUE(database.Execute("CREATE TABLE t(a)"));
  const auto insert = [&] { return database.Execute("INSERT INTO t VALUES(1)"); };
  const auto done = database.Transact("cannot do both", [&]() -> hal::Result<void> {
    EXPECT_TRUE(insert());
    const auto inner = database.Transact("cannot do the second", insert);
    EXPECT_FALSE(inner);
    if (!inner) {
      EXPECT_EQ(inner.error().kind, ErrorKind::kInternal);
      EXPECT_THAT(inner.error().message, HasSubstr("cannot do the second: within a transaction"));
    }
    EXPECT_TRUE(database.in_transaction()) << "the outer one goes on";
    return insert();
  });
  EXPECT_TRUE(done);
  EXPECT_EQ(database.Integer("SELECT count(*) FROM t").value(), 2);
  EXPECT_TRUE(database.Transact("cannot", insert));
  EXPECT_THROW((void)database.Transact("cannot", []() -> hal::Result<void> { throw 1; }), int);
  EXPECT_TRUE(database.Transact("cannot", insert));
  EXPECT_EQ(database.Integer("SELECT count(*) FROM t").value(), 4);
}

TEST_F(DatabaseTest, SaysWhichFileAndWhat) {
  const Database database = Opened({.otherwise = ErrorKind::kBadInput});
  const auto wrong = database.Prepare("SELECT a FROM absent");
  ASSERT_FALSE(wrong);
  EXPECT_EQ(wrong.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(wrong.error().message,
            path_ + ": cannot run \"SELECT a FROM absent\": no such table: absent");
  const std::string beginning = "SELECT 1; SELECT 2; SELECT 3; SELECT 4; SELECT 5; SELECT 67; ";
  EXPECT_EQ(database.Execute(beginning + "SELECT a FROM absent").error().message,
            path_ + ": cannot run \"" + beginning.substr(0, 60) + "...\": no such table: absent");
  EXPECT_EQ(Opened().Integer("SELECT a").error().kind, ErrorKind::kInternal);
}

TEST_F(DatabaseTest, TellsDamageFromTheRest) {
  std::ofstream(path_) << std::string(4096, 'x');
  const Database database = Opened({.mend_damage = "; move it away"});
  const auto read = database.Integer("SELECT count(*) FROM sqlite_schema");
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().kind, ErrorKind::kBadInput);
  EXPECT_THAT(read.error().message, HasSubstr("file is not a database; move it away"));
}

TEST_F(DatabaseTest, CreatesOnlyWhereItMay) {
  for (const Access access : {Access::kRead, Access::kWrite}) {
    EXPECT_FALSE(Database::Open(path_, path_, {.access = access}));
  }
  EXPECT_FALSE(std::filesystem::exists(path_));
  ASSERT_TRUE(Opened().Execute("CREATE TABLE t(a)"));
  EXPECT_FALSE(Opened({.access = Access::kRead}).Execute("INSERT INTO t VALUES(1)"));
  EXPECT_TRUE(Opened({.access = Access::kWrite}).Execute("INSERT INTO t VALUES(1)"));
}

TEST_F(DatabaseTest, IsBusyWhileAnotherWrites) {
  const Database writer = Opened();
  ASSERT_TRUE(writer.Execute("CREATE TABLE t(a); BEGIN IMMEDIATE"));
  const Database other = Opened({.busy_timeout = std::chrono::milliseconds(1)});
  const auto busy = other.Transact("cannot write", [] { return hal::Result<void>{}; });
  ASSERT_FALSE(busy);
  EXPECT_EQ(busy.error().message, path_ + ": cannot write: database is locked");
  ASSERT_TRUE(writer.Execute("COMMIT"));
  EXPECT_TRUE(other.Transact("cannot write", [] { return hal::Result<void>{}; }));
}

TEST_F(DatabaseTest, IsNoneWhenMovedFrom) {
  Database first = Opened();
  const Database second = std::move(first);
  EXPECT_FALSE(first);  // NOLINT(bugprone-use-after-move)
  EXPECT_TRUE(second);
}

}  // namespace
}  // namespace bendloop::drivers
