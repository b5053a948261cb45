// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/temporary_folder.h"

#include <cerrno>
#include <cstdlib>
#include <string>
#include <system_error>

namespace bendloop::host {

hal::Result<TemporaryFolder> TemporaryFolder::Make() {
  std::error_code error;
  const auto beside = std::filesystem::temp_directory_path(error);
  std::string name = (beside / "bendloop-XXXXXX").string();
  if (error || mkdtemp(name.data()) == nullptr) {
    const std::error_code why = error ? error : std::error_code(errno, std::generic_category());
    return hal::Fail(hal::ErrorKind::kDevice, name + ": cannot be made: " + why.message());
  }
  return TemporaryFolder(name);
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

}  // namespace bendloop::host
