// SPDX-License-Identifier: Apache-2.0
#include "hal/folder.h"

#include <dirent.h>

#include <cerrno>
#include <string_view>

#include "hal/scope_exit.h"

namespace bendloop::hal {

std::vector<std::filesystem::path> PathsIn(const std::filesystem::path& folder,
                                           std::error_code& error) {
  std::vector<std::filesystem::path> paths;
  error.clear();
  DIR* const open = ::opendir(folder.c_str());
  if (open == nullptr) {
    error.assign(errno, std::generic_category());
    return paths;
  }
  const ScopeExit close([open] { ::closedir(open); });
  for (;;) {
    errno = 0;
    const dirent* const entry = ::readdir(open);
    if (entry == nullptr) {
      if (errno != 0) error.assign(errno, std::generic_category());
      return paths;
    }
    const std::string_view name = entry->d_name;
    if (name != "." && name != "..") paths.push_back(folder / name);
  }
}

}  // namespace bendloop::hal
