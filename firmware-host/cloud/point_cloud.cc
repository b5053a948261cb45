// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cloud/point_cloud.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <memory>
#include <new>
#include <system_error>
#include <utility>

#include "firmware-host/cloud/formats.h"
#include "firmware-host/cloud/text.h"

namespace bendloop::host {
namespace {

constexpr double kAbsurd_mm = 1e6;
// A pipe does not say how much will come.
constexpr std::size_t kMaxPipeBytes = std::size_t{2} << 30;
// The file itself and its points, which in memory are twice as large as in a binary file.
constexpr std::size_t kMemoryPerByte = 3;

tl::unexpected<hal::Error> Bad(std::string_view name, const std::string& message) {
  return hal::Fail(hal::ErrorKind::kBadInput, std::string(name) + ": " + message);
}

std::string ErrnoText() { return std::generic_category().message(errno); }

class File {
 public:
  explicit File(const std::string& path) : fd_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  ~File() {
    if (fd_ >= 0) close(fd_);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd() const { return fd_; }

  // Up to `size` bytes; fewer at the end of the file, -1 on errors.
  ssize_t Read(char* data, std::size_t size) const {
    std::size_t done = 0;
    while (done < size) {
      const ssize_t got = read(fd_, data + done, std::min(size - done, std::size_t{1} << 28));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return -1;
      if (got == 0) break;
      done += static_cast<std::size_t>(got);
    }
    return static_cast<ssize_t>(done);
  }

 private:
  int fd_;
};

struct Bytes {
  std::unique_ptr<char[]> data;  // not a string: that would be cleared before it is read
  std::size_t size = 0;
};

hal::Result<Bytes> ReadPipe(const File& file, const std::string& path) {
  Bytes bytes;
  std::size_t capacity = std::size_t{1} << 16;
  bytes.data = std::make_unique_for_overwrite<char[]>(capacity);
  while (true) {
    const ssize_t got = file.Read(bytes.data.get() + bytes.size, capacity - bytes.size);
    if (got < 0) return Bad(path, "cannot be read: " + ErrnoText());
    bytes.size += static_cast<std::size_t>(got);
    if (bytes.size < capacity) return bytes;
    if (capacity >= kMaxPipeBytes) {
      return Bad(path, "more than " + std::to_string(kMaxPipeBytes >> 30) +
                           " GiB came through the pipe; expected less, or a regular file");
    }
    auto larger = std::make_unique_for_overwrite<char[]>(2 * capacity);
    std::copy_n(bytes.data.get(), bytes.size, larger.get());
    bytes.data = std::move(larger);
    capacity *= 2;
  }
}

hal::Result<Bytes> ReadBytes(const std::string& path) {
  const File file(path);
  struct stat status {};
  if (file.fd() < 0 || fstat(file.fd(), &status) != 0) {
    return Bad(path, "cannot be opened: " + ErrnoText());
  }
  if (S_ISDIR(status.st_mode)) return Bad(path, "is a directory, expected a point cloud file");
  if (S_ISFIFO(status.st_mode)) return ReadPipe(file, path);
  if (!S_ISREG(status.st_mode)) return Bad(path, "is a device, expected a file or a pipe");
  Bytes bytes;
  bytes.size = static_cast<std::size_t>(status.st_size);
  if (bytes.size > kMaxCloudBytes) {
    return Bad(path, std::to_string(bytes.size) + " bytes, expected at most " +
                         std::to_string(kMaxCloudBytes));
  }
  const std::size_t memory = static_cast<std::size_t>(std::max(0L, sysconf(_SC_PHYS_PAGES))) *
                             static_cast<std::size_t>(std::max(0L, sysconf(_SC_PAGESIZE)));
  if (memory > 0 && bytes.size > memory / kMemoryPerByte) {
    return Bad(path, std::to_string(bytes.size) + " bytes need about " +
                         std::to_string(kMemoryPerByte * bytes.size >> 20) +
                         " MiB of memory, this machine has " + std::to_string(memory >> 20) +
                         "; thin the cloud");
  }
  bytes.data = std::make_unique_for_overwrite<char[]>(bytes.size);
  const ssize_t got = file.Read(bytes.data.get(), bytes.size);
  if (got < 0) return Bad(path, "cannot be read: " + ErrnoText());
  bytes.size = static_cast<std::size_t>(got);
  return bytes;
}

// Formats that people mistake for point clouds that we read.
const char* KnownStranger(std::string_view bytes) {
  struct Magic {
    std::string_view bytes;
    const char* name;
  };
  static constexpr std::array<Magic, 14> kMagics = {{
      {"\x1f\x8b", "a gzip archive"},
      {"PK\x03\x04", "a zip archive or a spreadsheet"},
      {"\x28\xb5\x2f\xfd", "a zstd archive"},
      {"LASF", "a LAS or LAZ cloud"},
      {"ASTM-E57", "an E57 cloud"},
      {"SQLite format 3", "a database, perhaps a recorded session"},
      {"solid ", "an STL mesh"},
      {"OFF", "an OFF mesh"},
      {"glTF", "a glTF scene"},
      {"ISO-10303-21", "a STEP model"},
      {"<?xml", "XML"},
      {"{", "JSON"},
      {"\xff\xfe", "text in UTF-16 (save it as UTF-8)"},
      {"\xfe\xff", "text in UTF-16 (save it as UTF-8)"},
  }};
  for (const Magic& magic : kMagics) {
    if (bytes.starts_with(magic.bytes)) return magic.name;
  }
  return nullptr;
}

}  // namespace

hal::Result<Units> UnitsFromName(std::string_view name) {
  if (name == "mm") return Units::kMillimetres;
  if (name == "m") return Units::kMetres;
  if (name == "in") return Units::kInches;
  return hal::Fail(hal::ErrorKind::kUsage, "units " + Found(name) + ", expected mm, m or in");
}

double MillimetresPer(Units units) {
  switch (units) {
    case Units::kMetres:
      return 1000.0;
    case Units::kInches:
      return 25.4;
    case Units::kMillimetres:
      break;
  }
  return 1.0;
}

hal::Result<PointCloud> ParseCloud(std::string_view bytes, std::string_view name, Units units) {
  constexpr std::string_view kExpected = "expected PLY, PCD or text with a point a line";
  if (bytes.empty()) return Bad(name, "is empty, " + std::string(kExpected));
  if (bytes.starts_with("\xef\xbb\xbf")) bytes.remove_prefix(3);  // UTF-8 byte order mark
  const double mm_per_unit = MillimetresPer(units);
  hal::Result<PointCloud> cloud;
  if (IsPly(bytes)) {
    cloud = ParsePly(bytes, name, mm_per_unit);
  } else if (IsPcd(bytes)) {
    cloud = ParsePcd(bytes, name, mm_per_unit);
  } else if (const char* stranger = KnownStranger(bytes)) {
    return Bad(name, "looks like " + std::string(stranger) + ", " + std::string(kExpected));
  } else if (const std::size_t nul = bytes.substr(0, 4096).find('\0');
             nul != std::string_view::npos) {
    return BadByte(name, nul, "unknown binary data, " + std::string(kExpected));
  } else {
    cloud = ParseXyz(bytes, name, mm_per_unit);
  }
  if (!cloud) return cloud;
  if (cloud->points_mm.empty() && cloud->dropped_non_finite > 0) {
    return Bad(name, "all " + std::to_string(cloud->dropped_non_finite) +
                         " points are NaN or infinite, expected coordinates");
  }
  if (cloud->points_mm.empty()) return Bad(name, "holds no points, expected at least one");
  if (cloud->dropped_non_finite > 0) {
    cloud->warnings.push_back("left out " + std::to_string(cloud->dropped_non_finite) +
                              " points with NaN or infinite coordinates");
  }
  const auto far =
      std::count_if(cloud->points_mm.begin(), cloud->points_mm.end(),
                    [](const Eigen::Vector3d& p) { return p.cwiseAbs().maxCoeff() > kAbsurd_mm; });
  if (far > 0) {
    cloud->warnings.push_back(std::to_string(far) +
                              " points lie more than 1 km from the origin; check --units");
  }
  return cloud;
}

hal::Result<PointCloud> ReadCloud(const std::string& path, Units units) {
  try {
    const auto bytes = ReadBytes(path);
    if (!bytes) return hal::Fail(bytes.error());
    return ParseCloud({bytes->data.get(), bytes->size}, path, units);
  } catch (const std::bad_alloc&) {
    return Bad(path, "the machine has not enough memory for it; thin the cloud");
  }
}

}  // namespace bendloop::host
