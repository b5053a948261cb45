// SPDX-License-Identifier: Apache-2.0
#include "hal/folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace bendloop::hal {
namespace {

namespace fs = std::filesystem;

TEST(PathsIn, AreThoseOfTheFolderAndNotOfThoseInIt) {
  std::string name = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
  const fs::path folder = mkdtemp(name.data());
  fs::create_directory(folder / "b");
  for (const char* file : {"a", ".hidden", "b/c"}) std::ofstream(folder / file) << "x";
  std::error_code error = std::make_error_code(std::errc::io_error);
  EXPECT_THAT(PathsIn(folder, error),
              ::testing::UnorderedElementsAre(folder / "a", folder / ".hidden", folder / "b"));
  EXPECT_FALSE(error);
  EXPECT_TRUE(PathsIn(folder / "b" / "none", error).empty());
  EXPECT_EQ(error, std::errc::no_such_file_or_directory);
  EXPECT_TRUE(PathsIn(folder / "a", error).empty());
  EXPECT_EQ(error, std::errc::not_a_directory);
  fs::remove_all(folder);
}

}  // namespace
}  // namespace bendloop::hal
