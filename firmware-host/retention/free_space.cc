// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/retention/free_space.h"

#include <sys/statvfs.h>

#include <cerrno>

namespace bendloop::host {

std::optional<FreeSpace> FreeSpaceAt(const std::filesystem::path& place) {
  struct statvfs system {};
  if (statvfs(place.c_str(), &system) != 0) {
    const bool is_to_come = errno == ENOENT && place.has_relative_path();
    return is_to_come ? FreeSpaceAt(place.parent_path()) : std::nullopt;
  }
  FreeSpace space;
  space.bytes = static_cast<std::uint64_t>(system.f_bavail) * system.f_frsize;
  if (system.f_files > 0) space.names = system.f_favail;
  return space;
}

}  // namespace bendloop::host
