// SPDX-License-Identifier: Apache-2.0
#include <archive.h>
#include <archive_entry.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>

#include "firmware-host/support/cell_places.h"
#include "firmware-host/support/support_bundle.h"
#include "firmware-host/support/tar_file.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class TarFile : public ::testing::Test {
 protected:
  TarFile() {
    std::string name = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
    folder_ = mkdtemp(name.data());
  }
  ~TarFile() override { fs::remove_all(folder_); }
  static std::string Text(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  // A tar of one entry that a stranger may have made.
  fs::path Foreign(const std::function<void(archive_entry*)>& shape) const {
    const fs::path path = folder_ / "foreign.tar";
    archive* const tar = archive_write_new();
    archive_write_set_format_pax_restricted(tar);
    archive_write_open_filename(tar, path.c_str());
    archive_entry* const entry = archive_entry_new();
    archive_entry_set_pathname(entry, "a");
    archive_entry_set_size(entry, 0);
    archive_entry_set_filetype(entry, AE_IFREG);
    archive_entry_set_perm(entry, 0644);
    shape(entry);
    archive_write_header(tar, entry);
    archive_entry_free(entry);
    archive_write_free(tar);
    return path;
  }

  fs::path folder_;
};

TEST_F(TarFile, ComesBackAsItWasWritten) {
  const fs::path file = folder_ / "file";
  const std::string bytes(200'000, 'b');
  std::ofstream(file) << bytes;
  const fs::path path = folder_ / "x.tar.gz";
  auto tar = TarWriter::Create(path);
  ASSERT_TRUE(tar) << tar.error().message;
  ASSERT_TRUE(tar->AddText("deep/er/text", "words\n"));
  ASSERT_TRUE(tar->AddFile("file", file));
  EXPECT_FALSE(tar->AddFile("none", folder_ / "none"));
  ASSERT_TRUE(tar->AddText("last", ""));
  ASSERT_TRUE(tar->Finish());
  EXPECT_TRUE(IsTar(path));
  EXPECT_FALSE(IsTar(file));
  EXPECT_LT(fs::file_size(path), 10'000u);
  const auto done = Unpack(path, folder_ / "out", 1'000'000);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(Text(folder_ / "out/deep/er/text"), "words\n");
  EXPECT_EQ(Text(folder_ / "out/file"), bytes);
  EXPECT_TRUE(fs::exists(folder_ / "out/last"));
  EXPECT_THAT(Unpack(path, folder_ / "less", 100'000).error().message, HasSubstr("too large"));
  // Cut in the middle.
  fs::resize_file(path, fs::file_size(path) / 2);
  EXPECT_FALSE(Unpack(path, folder_ / "half", 1'000'000));
}

TEST_F(TarFile, AStrangersTarReachesNothingElse) {
  const auto refused = [&](const std::function<void(archive_entry*)>& shape) {
    const auto done = Unpack(Foreign(shape), folder_ / "out", 1000);
    EXPECT_FALSE(done);
    return done ? "" : done.error().message;
  };
  for (const char* name : {"../outside", "/tmp/bendloop-outside", "a/../../outside"}) {
    EXPECT_THAT(refused([&](archive_entry* e) { archive_entry_set_pathname(e, name); }),
                HasSubstr("no plain file below it"));
  }
  EXPECT_NE(refused([](archive_entry* e) {
              archive_entry_set_filetype(e, AE_IFLNK);
              archive_entry_set_symlink(e, "/etc/passwd");
            }),
            "");
  EXPECT_NE(refused([](archive_entry* e) { archive_entry_set_hardlink(e, "/etc/passwd"); }), "");
  EXPECT_NE(refused([](archive_entry* e) { archive_entry_set_filetype(e, AE_IFIFO); }), "");
  EXPECT_FALSE(fs::exists(folder_ / "outside"));
}

// What a bundle is asked for most is a cell that does not start.
TEST_F(TarFile, ABundleOfACellFileThatIsWrongHasWhatItNames) {
  fs::create_directories(folder_ / "etc");
  fs::create_directories(folder_ / "state/results");
  fs::create_directories(folder_ / "recordings");
  std::ofstream(folder_ / "etc/cell.toml")
      << "schema = \"bendloop.cell/1\"\nnam = 7\npart = \"elbow.toml\"\n"
      << "state_dir = '../state'\n[record]\ndirectory = \"" << (folder_ / "recordings").string()
      << "\"\n[bender]\nregister_map = \"nowhere.toml\"\n";
  std::ofstream(folder_ / "etc/elbow.toml") << "the part\n";
  std::ofstream(folder_ / "state/results/part-0003.json") << "{}\n";
  std::ofstream(folder_ / "recordings/part-0003.session") << "a scan\n";
  std::ofstream(folder_ / "log") << "it does not start\n";
  SupportBundleOptions options;
  options.config = folder_ / "etc/cell.toml";
  options.log = folder_ / "log";
  options.findings = "{}\n";
  const auto notes = WriteSupportBundle(folder_ / "bundle.tar.gz", options);
  ASSERT_TRUE(notes) << notes.error().message;
  ASSERT_TRUE(Unpack(folder_ / "bundle.tar.gz", folder_ / "out", 1'000'000));
  EXPECT_EQ(Text(folder_ / "out/config/cell.toml.original"), Text(options.config));
  EXPECT_EQ(Text(folder_ / "out/config/part.toml"), "the part\n");
  EXPECT_EQ(Text(folder_ / "out/state/results/part-0003.json"), "{}\n");
  EXPECT_EQ(Text(folder_ / "out/state/sessions/part-0003.session"), "a scan\n");
  EXPECT_EQ(Text(folder_ / "out/bendloopd.log"), "it does not start\n");
  const std::string missing = Text(folder_ / "out/bundle.json");
  EXPECT_THAT(missing, HasSubstr("settings that hold: "));
  EXPECT_THAT(missing, HasSubstr("'nam'"));
  EXPECT_THAT(missing, HasSubstr("nowhere.toml"));
  // A name that leads to nothing is a slip of the hand, and no bundle.
  options.config = folder_ / "etc/cel.toml";
  EXPECT_EQ(WriteSupportBundle(folder_ / "none.tar.gz", options).error().kind,
            hal::ErrorKind::kBadInput);
  EXPECT_FALSE(fs::exists(folder_ / "none.tar.gz"));
}

TEST(SupportBundle, TheCellFileNamesWhatIsBesideIt) {
  EXPECT_EQ(WithBundledPaths("schema = \"bendloop.cell/1\"\npart = \"../parts/elbow.toml\"\n"
                             "  state_dir=\"/var/lib/bendloop\" # there\nparts_dir = '/x'\n"
                             "[record]\ndirectory = \"/data\"\n[bender]\n"
                             "register_map = \"maps/plc.toml\"\n"),
            "schema = \"bendloop.cell/1\"\npart = \"part.toml\"\n"
            "  state_dir=\"../state\" # there\nparts_dir = \"parts\"\n"
            "[record]\ndirectory = \"sessions\"\n[bender]\n"
            "register_map = \"register-map.toml\"\n");
}

}  // namespace
}  // namespace bendloop::host
