// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>

#include "hal/result.h"

namespace bendloop::host {

// Drops from the commit journal and the tube ledger what is older than this (retention/age.h). The
// newest 1000 of everything stay, so that a name, a sequence number or a tube is never taken for a
// new one, and so do attempts and scans whose end is not known, or that still wait, and what the
// bender was seen to break. A long past is dropped in pieces: so many rows a call.
hal::Result<void> DropOldFromJournal(const std::filesystem::path& journal, double most_days,
                                     std::int64_t now_ms);

}  // namespace bendloop::host
