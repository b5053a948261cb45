// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/demo/demo_files.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <string>

namespace bendloop::host {
namespace {

TEST(DemoFiles, OfAFullDiskNoRecordingStaysHalf) {
  std::string pattern = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
  const std::filesystem::path out = mkdtemp(pattern.data());
  RemoveUnfinished(out);  // not so far yet
  std::filesystem::create_directory(out / "sessions");
  for (const char* name : {"part-0001.session", "part-0002.session", "part-0002.session-wal",
                           "part-0002.session-shm"}) {
    std::ofstream(out / "sessions" / name) << "x";
  }
  RemoveUnfinished(out);
  std::set<std::string> left;
  for (const auto& entry : std::filesystem::directory_iterator(out / "sessions")) {
    left.insert(entry.path().filename().string());
  }
  EXPECT_EQ(left, std::set<std::string>{"part-0001.session"});
  std::filesystem::remove_all(out);
}

}  // namespace
}  // namespace bendloop::host
