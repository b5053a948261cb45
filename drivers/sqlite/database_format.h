// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "drivers/sqlite/database.h"

namespace bendloop::drivers {

// Whose a database file is, and how it came to be what it is now.
struct DatabaseFormat {
  int application_id = 0;    // PRAGMA application_id
  const char* letters = "";  // the same, as people read it: "BLHI"
  const char* kind = "";     // "history of parts"
  // What makes version 1 out of an empty file, then version 2 out of version 1, and so on. A step
  // that was published is never changed.
  std::span<const char* const> steps;

  int version() const { return static_cast<int>(steps.size()); }
};

// Brings the file to the newest version, one step after the other, all or none of them: an empty
// file is given everything. Refuses, with kBadInput and without having written a byte, another
// program's database and one of a newer version, which this one would not understand.
hal::Result<void> BringToFormat(const Database& database, const DatabaseFormat& format);
// The same for who only reads: nothing is written, and one of an older version is refused, too.
hal::Result<void> ExpectFormat(const Database& database, const DatabaseFormat& format);

}  // namespace bendloop::drivers
