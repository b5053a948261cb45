// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/state_store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>

#include "firmware-host/console/temporary_folder.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

uid_t OwnerOf(const fs::path& path) {
  struct stat facts {};
  EXPECT_EQ(::lstat(path.c_str(), &facts), 0) << path;
  return facts.st_uid;
}

TEST(StateStore, WhatRootWritesBelongsToTheFoldersOwner) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can give files away";
  constexpr uid_t kNobody = 65534;
  const auto folder = TemporaryFolder::Make();
  ASSERT_TRUE(folder) << folder.error().message;
  const fs::path directory = folder->path() / "state";
  const fs::path elsewhere = folder->path() / "elsewhere";
  fs::create_directory(directory);
  ASSERT_EQ(::chown(directory.c_str(), kNobody, kNobody), 0);
  std::ofstream(elsewhere) << "root's";
  {
    const auto store = StateStore::Open(directory);
    ASSERT_TRUE(store) << store.error().message;
    std::ofstream(store->requests_log()) << "{}";
    fs::create_symlink(elsewhere, directory / "link");
    fs::create_hard_link(elsewhere, directory / "second-name");
  }
  for (const char* name : {"lock", "requests", "requests.log", "results"}) {
    EXPECT_EQ(OwnerOf(directory / name), kNobody) << name;
  }
  EXPECT_EQ(OwnerOf(elsewhere), 0u);
}

}  // namespace
}  // namespace bendloop::host
