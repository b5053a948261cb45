// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/retention/free_space.h"

#include <sys/statvfs.h>

namespace bendloop::host {

std::optional<FreeSpace> FreeSpaceAt(const std::filesystem::path& place) {
  struct statvfs system {};
  if (statvfs(place.c_str(), &system) != 0) return std::nullopt;
  FreeSpace space;
  space.bytes = static_cast<std::uint64_t>(system.f_bavail) * system.f_frsize;
  if (system.f_files > 0) space.names = system.f_favail;
  return space;
}

}  // namespace bendloop::host
