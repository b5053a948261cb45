// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/output_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstdio>
#include <optional>
#include <random>
#include <string>
#include <system_error>
#include <utility>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// As many as the kernel follows (path_resolution(7)).
constexpr int kMostLinks = 40;
// A random name that is taken is a coincidence; one that is taken again and again is not.
constexpr int kMostNames = 16;

tl::unexpected<hal::Error> Failed(const fs::path& path, const char* what, int why) {
  return hal::Fail(hal::ErrorKind::kDevice, path.string() + ": cannot " + what + ": " +
                                                std::generic_category().message(why) +
                                                "; check the disk and its rights");
}

// A descriptor that is closed with this object.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  int number() const { return number_; }
  // False when what was written did not arrive after all, as on network disks.
  bool Close() { return ::close(std::exchange(number_, -1)) == 0; }

 private:
  int number_;
};

bool WriteAll(int file, std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(file, text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(written));
  }
  return true;
}

// The N of /dev/fd/N and /dev/stdout: opened anew, it would begin at the file's start.
std::optional<int> DescriptorOf(const std::string& path) {
  if (path == "/dev/stdout") return STDOUT_FILENO;
  if (path == "/dev/stderr") return STDERR_FILENO;
  for (const std::string_view folder : {"/dev/fd/", "/proc/self/fd/"}) {
    if (path.rfind(folder, 0) != 0) continue;
    int number = -1;
    const char* const end = path.data() + path.size();
    const auto [stop, error] = std::from_chars(path.data() + folder.size(), end, number);
    if (error == std::errc() && stop == end && number >= 0) return number;
  }
  return std::nullopt;
}

hal::Result<void> WriteStraight(const fs::path& path, int file, std::string_view text) {
  if (file < 0) return Failed(path, "open", errno);
  Descriptor opened(file);
  if (!WriteAll(file, text)) return Failed(path, "write", errno);
  if (!opened.Close()) return Failed(path, "write", errno);
  return {};
}

std::string RandomName(const fs::path& path, std::random_device& random) {
  char digits[20];
  std::snprintf(digits, sizeof digits, "%08x%08x", random(), random());
  return (path.parent_path() / ("." + path.filename().string() + "." + digits)).string();
}

// Beside the file, so that the name can be changed in one step; nobody else's, and no link.
hal::Result<void> Replace(const fs::path& path, const std::optional<struct stat>& before,
                          std::string_view text) {
  std::random_device random;
  std::string beside;
  int number = -1;
  for (int i = 0; i < kMostNames && number < 0; ++i) {
    beside = RandomName(path, random);
    number = ::open(beside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (number < 0 && errno != EEXIST) break;
  }
  if (number < 0) return Failed(path, "create", errno);
  Descriptor file(number);
  const auto fail = [&](const char* what) {
    const int why = errno;
    ::unlink(beside.c_str());
    return Failed(path, what, why);
  };
  if (before) {
    // Who may not give a file away keeps it; the mode comes after, as a new owner clears bits of
    // it.
    if (::fchown(number, before->st_uid, before->st_gid) != 0 && errno != EPERM) {
      return fail("keep the owner");
    }
    if (::fchmod(number, before->st_mode & 07777) != 0) return fail("keep the mode");
  }
  if (!WriteAll(number, text)) return fail("write");
  if (::fsync(number) != 0) return fail("flush");
  if (!file.Close()) return fail("write");
  if (::rename(beside.c_str(), path.c_str()) != 0) return fail("rename");
  return {};
}

}  // namespace

hal::Result<fs::path> FollowLinks(const fs::path& path) {
  fs::path at = path;
  for (int i = 0; i < kMostLinks; ++i) {
    std::error_code error;
    const fs::path to = fs::read_symlink(at, error);
    if (error) return at;  // no link, or nothing at all
    at = to.is_absolute() ? to : at.parent_path() / to;
  }
  return Failed(path, "follow", ELOOP);
}

hal::Result<void> WriteOutputFile(const fs::path& path, std::string_view text) {
  if (const auto number = DescriptorOf(path.string())) {
    return WriteStraight(path, ::dup(*number), text);
  }
  struct stat found {};
  if (::stat(path.c_str(), &found) == 0) {
    if (!S_ISREG(found.st_mode)) {
      return WriteStraight(path, ::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC), text);
    }
    const auto file = FollowLinks(path);
    if (!file) return hal::Fail(file.error());
    return Replace(*file, found, text);
  }
  if (errno != ENOENT) return Failed(path, "open", errno);
  const auto file = FollowLinks(path);
  if (!file) return hal::Fail(file.error());
  return Replace(*file, std::nullopt, text);
}

}  // namespace bendloop::host
