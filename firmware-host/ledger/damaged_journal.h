// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "hal/result.h"

namespace bendloop::host {

// Before a journal is opened: one that SQLite cannot read, or whose newest rows make no sense, is
// moved aside (drivers/sqlite/damaged_file.h), and an empty one begins. Returns where it lies now;
// nullopt: it was sound, or there was none. Errors: kDevice when it cannot be moved; whatever else
// is wrong with it (another program's file, one of a newer version) opening it tells.
hal::Result<std::optional<std::filesystem::path>> SetDamagedJournalAside(
    const std::filesystem::path& journal, std::int64_t unix_ms);

// Where a journal was moved aside, now or in an earlier run that ended before it came to it, nobody
// knows any more what was sent: corrections are locked, as by a bender that broke a rule, until
// somebody acknowledges. Each such file locks once.
hal::Result<void> LockForDamagedJournals(const std::filesystem::path& journal);

}  // namespace bendloop::host
