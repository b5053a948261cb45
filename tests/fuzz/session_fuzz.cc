// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_drivers_session
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "drivers/session/session_check.h"
#include "drivers/session/session_source.h"
#include "tests/fuzz/reached.h"

namespace {

using namespace bendloop;

Reached checked("a session that is right");
Reached replayed("a profile that is replayed");
Reached left_out("a profile that is left out");

// A file with a name, in memory: SQLite opens no descriptor and nothing in /proc. Removed at the
// end; what a crash leaves is a few KB.
class SessionFile {
 public:
  SessionFile() {
    std::error_code none;
    const std::filesystem::path memory = "/dev/shm";
    const auto folder = std::filesystem::is_directory(memory, none)
                            ? memory
                            : std::filesystem::temp_directory_path();
    path_ = (folder / "bendloop-session-fuzz-XXXXXX").string();
    file_ = mkstemp(path_.data());
    if (file_ < 0) __builtin_trap();
  }
  ~SessionFile() {
    close(file_);
    unlink(path_.c_str());
  }
  void Fill(const std::uint8_t* data, std::size_t size) {
    if (ftruncate(file_, 0) != 0) __builtin_trap();
    if (pwrite(file_, data, size, 0) != static_cast<ssize_t>(size)) __builtin_trap();
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  int file_ = -1;
};

}  // namespace

// Any bytes as a session file: checked and replayed without a crash, within what was announced.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static SessionFile file;
  file.Fill(data, size);
  const auto summary = drivers::CheckSession(file.path());
  if (summary && summary->ok()) checked.Mark();
  hal::ManualClock clock;
  drivers::SessionSource source(file.path(), drivers::ReplayPace::kRecorded, clock);
  std::size_t profiles = 0;
  bool failed = true;
  if (const auto info = source.Open(); info && source.Start()) {
    hal::LaserProfile profile(info->max_points);
    hal::ScanEvent event;
    while (true) {
      const auto status = source.Read(profile, event, std::chrono::hours(1'000'000));
      failed = !status;
      if (failed || *status == hal::ReadStatus::kEnd) break;
      if (*status != hal::ReadStatus::kProfile) continue;
      ++profiles;
      replayed.Mark();
      if (profile.points.size() > info->max_points) __builtin_trap();
    }
    if (source.profiles_left_out() > 0) left_out.Mark();
  }
  // What is said to be right is replayed, all of it.
  if (summary && summary->ok() && (failed || profiles != summary->profiles)) __builtin_trap();
  return 0;
}
