// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string_view>

#include "hal/result.h"

namespace bendloop::host {

// Writes `text` to where a user or the daemon said, whatever that is:
//   a regular file, or none yet   the whole text or nothing: to a file of a random name beside it,
//                                 flushed, then renamed; an existing file keeps its mode
//   a symbolic link               the file that it names, which stays where it is
//   anything else                 straight: a device, a FIFO, the shell's >(command)
//   /dev/stdout, /dev/fd/N        straight, where that descriptor stands
// kDevice when it cannot be written.
hal::Result<void> WriteOutputFile(const std::filesystem::path& path, std::string_view text);

// The file behind a chain of symbolic links; the path itself when it is none.
hal::Result<std::filesystem::path> FollowLinks(const std::filesystem::path& path);

}  // namespace bendloop::host
