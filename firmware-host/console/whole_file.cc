// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/whole_file.h"

#include <fstream>

namespace bendloop::host {

hal::Result<std::string> ReadWholeFile(const std::filesystem::path& path, std::size_t most_bytes) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     path.string() + ": cannot be opened, expected a readable file");
  }
  std::string text;
  char block[65536];
  while (file.read(block, sizeof block), file.gcount() > 0) {
    text.append(block, static_cast<std::size_t>(file.gcount()));
    if (text.size() > most_bytes) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       path.string() + ": longer than " + std::to_string(most_bytes) + " bytes");
    }
  }
  return text;
}

}  // namespace bendloop::host
