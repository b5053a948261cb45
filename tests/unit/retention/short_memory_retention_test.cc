// SPDX-License-Identifier: Apache-2.0
// Want of memory at each allocation of a clearing up: what is pinned or in hand stays, and what
// goes goes with its side files.
#include <gtest/gtest.h>
#include <pthread.h>

#include <fstream>
#include <new>

#include "firmware-host/console/temporary_folder.h"
#include "firmware-host/retention/retention.h"
#include "tests/support/short_memory.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using test::ShortMemory;

class ShortMemoryRetention : public ::testing::Test {
 protected:
  void Put(const std::string& name) const { std::ofstream(folder_->path() / name) << "12345678"; }
  bool Has(const std::string& name) const { return fs::exists(folder_->path() / name); }
  void Fill() const {
    Put("part-0001.session");
    Put("part-0001.session.keep");
    for (const char* name : {"part-0002.session", "part-0002.session-wal", "part-0003.session",
                             "part-0003.session-wal", "part-0004.session"}) {
      Put(name);
    }
  }
  // How many allocations failed.
  std::int64_t ClearShortOf(std::int64_t number, ShortMemory::Lasts lasts) const {
    const std::set<std::string> in_hand = {"part-0004"};
    const RetentionPlaces places{folder_->path(), {}};
    RetentionLimits limits;
    limits.most_sessions_bytes = 0;
    const RetentionWorld world = SystemRetentionWorld();
    char name[16] = {};
    pthread_getname_np(pthread_self(), name, sizeof name);
    const ShortMemory shortage(name, number, lasts);
    try {
      static_cast<void>(KeepLimits(places, limits, in_hand, world));
    } catch (const std::bad_alloc&) {
    }
    return ShortMemory::failed();
  }

  const hal::Result<TemporaryFolder> folder_ = TemporaryFolder::Make();
};

TEST_F(ShortMemoryRetention, TakesNothingThatIsKept) {
  for (const auto lasts : {ShortMemory::Lasts::kOnce, ShortMemory::Lasts::kFromThenOn}) {
    int left = 0;
    for (std::int64_t number = 1;; ++number) {
      SCOPED_TRACE(number);
      Fill();
      const std::int64_t failed = ClearShortOf(number, lasts);
      ASSERT_TRUE(Has("part-0001.session")) << "pinned";
      ASSERT_TRUE(Has("part-0004.session")) << "in hand";
      for (const char* name : {"part-0002.session", "part-0003.session"}) {
        const bool is_there = Has(name);
        left += is_there;
        ASSERT_EQ(Has(std::string(name) + "-wal"), is_there) << name;
      }
      if (failed > 0) continue;
      EXPECT_FALSE(Has("part-0002.session"));
      break;
    }
    EXPECT_GT(left, 10);
  }
}

}  // namespace
}  // namespace bendloop::host
