// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::drivers {

// What is wrong with a database file by SQLite's own check of its whole structure; "": nothing, or
// there is no such file, or it is a disk's fault and not the file's, which opening it will tell.
std::string DamageOf(const std::filesystem::path& path);

// Moves a database away, with what SQLite keeps beside it, as NAME.damaged-20261122T145300Z; a file
// of that name is never overwritten: "-2", "-3" ... go behind it. Returns where it is now.
// `unix_ms` is the wall clock's. kDevice when the file cannot be moved.
hal::Result<std::filesystem::path> MoveAside(const std::filesystem::path& path,
                                             std::int64_t unix_ms);

// Those of `path` that were moved aside and lie there still, by their names.
std::vector<std::filesystem::path> MovedAside(const std::filesystem::path& path);

}  // namespace bendloop::drivers
