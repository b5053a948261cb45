// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/output_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <future>
#include <iterator>
#include <string>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string Slurp(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class OutputFile : public ::testing::Test {
 protected:
  OutputFile() {
    std::string name = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
    directory_ = mkdtemp(name.data());
  }
  ~OutputFile() override { fs::remove_all(directory_); }
  std::size_t Files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(directory_), fs::directory_iterator()));
  }
  fs::path directory_;
};

TEST_F(OutputFile, KeepsTheModeOfAFileAndLeavesNothingBeside) {
  const fs::path file = directory_ / "a.json";
  std::ofstream(file) << "before, and longer";
  ASSERT_EQ(chmod(file.c_str(), 0640), 0);
  ASSERT_TRUE(WriteOutputFile(file, "after"));
  struct stat now {};
  ASSERT_EQ(stat(file.c_str(), &now), 0);
  EXPECT_EQ(now.st_mode & 07777, 0640u);
  EXPECT_EQ(Slurp(file), "after");
  EXPECT_EQ(Files(), 1u);
}

TEST_F(OutputFile, ANewFileHasTheModeOfTheUmask) {
  const mode_t before = umask(027);
  ASSERT_TRUE(WriteOutputFile(directory_ / "new", "x"));
  umask(before);
  struct stat now {};
  ASSERT_EQ(stat((directory_ / "new").c_str(), &now), 0);
  EXPECT_EQ(now.st_mode & 07777, 0640u);
}

TEST_F(OutputFile, FollowsALinkAndLeavesIt) {
  fs::create_directory(directory_ / "deep");
  std::ofstream(directory_ / "deep" / "real") << "before";
  fs::create_symlink("deep/real", directory_ / "link");
  fs::create_symlink("nothing-yet", directory_ / "dangling");
  ASSERT_TRUE(WriteOutputFile(directory_ / "link", "after"));
  ASSERT_TRUE(WriteOutputFile(directory_ / "dangling", "new"));
  EXPECT_TRUE(fs::is_symlink(directory_ / "link"));
  EXPECT_EQ(Slurp(directory_ / "deep" / "real"), "after");
  EXPECT_TRUE(fs::is_symlink(directory_ / "dangling"));
  EXPECT_EQ(Slurp(directory_ / "nothing-yet"), "new");
  fs::create_symlink("round", directory_ / "round");
  EXPECT_FALSE(WriteOutputFile(directory_ / "round", "x"));
}

// Somebody who knows the temporary name would have us write where they like.
TEST_F(OutputFile, APlantedLinkBesideItIsNotFollowed) {
  std::ofstream(directory_ / "theirs") << "kept";
  fs::create_symlink("theirs", directory_ / "a.json.new");
  ASSERT_TRUE(WriteOutputFile(directory_ / "a.json", "ours"));
  EXPECT_EQ(Slurp(directory_ / "theirs"), "kept");
  EXPECT_EQ(Slurp(directory_ / "a.json"), "ours");
}

TEST_F(OutputFile, ADeviceStaysADevice) {
  ASSERT_TRUE(WriteOutputFile("/dev/null", "gone"));
  EXPECT_TRUE(fs::is_character_file("/dev/null"));
  const auto full = WriteOutputFile("/dev/full", "does not fit");
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().kind, hal::ErrorKind::kDevice);
  EXPECT_THAT(full.error().message, HasSubstr("/dev/full: cannot write: No space left on device"));
  EXPECT_TRUE(fs::is_character_file("/dev/full"));
}

TEST_F(OutputFile, AFifoIsWrittenStraight) {
  const fs::path fifo = directory_ / "fifo";
  ASSERT_EQ(mkfifo(fifo.c_str(), 0600), 0);
  auto reader = std::async(std::launch::async, [&] { return Slurp(fifo); });
  ASSERT_TRUE(WriteOutputFile(fifo, "through"));
  EXPECT_EQ(reader.get(), "through");
  EXPECT_TRUE(fs::is_fifo(fifo));
}

// As the shell gives it for >(command), and as people write /dev/stdout.
TEST_F(OutputFile, ADescriptorIsWrittenWhereItStands) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  ASSERT_TRUE(WriteOutputFile("/dev/fd/" + std::to_string(ends[1]), "through"));
  char block[16] = {};
  EXPECT_EQ(read(ends[0], block, sizeof block), 7);
  close(ends[0]);
  close(ends[1]);
}

TEST_F(OutputFile, SaysWhatItCouldNot) {
  const auto missing = WriteOutputFile(directory_ / "no" / "file", "x");
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("No such file or directory"));
  const auto folder = WriteOutputFile(directory_, "x");
  ASSERT_FALSE(folder);
  EXPECT_THAT(folder.error().message, HasSubstr("Is a directory"));
}

}  // namespace
}  // namespace bendloop::host
