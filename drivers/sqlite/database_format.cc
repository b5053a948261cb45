// SPDX-License-Identifier: Apache-2.0
#include "drivers/sqlite/database_format.h"

#include <string>

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

struct Found {
  std::int64_t application = 0;
  std::int64_t version = 0;
  std::int64_t tables = 0;

  bool is_empty() const { return application == 0 && version == 0 && tables == 0; }
};

Result<Found> Look(const Database& database) {
  Found found;
  const auto look = [&](const char* sql, std::int64_t& number) -> Result<void> {
    const auto read = database.Integer(sql);
    if (!read) return Fail(read.error());
    number = *read;
    return {};
  };
  if (auto done = look("PRAGMA application_id", found.application); !done)
    return Fail(done.error());
  if (auto done = look("PRAGMA user_version", found.version); !done) return Fail(done.error());
  auto done = look("SELECT count(*) FROM sqlite_master", found.tables);
  if (!done) return Fail(done.error());
  return found;
}

Result<void> CheckFound(const Database& database, const DatabaseFormat& format,
                        const Found& found) {
  if (found.is_empty()) return {};
  if (found.application != format.application_id) {
    return Fail(ErrorKind::kBadInput,
                database.path() + ": application_id " + std::to_string(found.application) +
                    ", expected " + std::to_string(format.application_id) + " (\"" +
                    format.letters + "\"): not a " + format.kind + "; choose another file");
  }
  if (found.version > format.version()) {
    return Fail(ErrorKind::kBadInput,
                database.path() + ": a " + format.kind + " of version " +
                    std::to_string(found.version) + ", and this bendloop knows versions up to " +
                    std::to_string(format.version()) +
                    ": a newer one wrote it; install that one again, or move the file away");
  }
  return {};
}

}  // namespace

Result<void> BringToFormat(const Database& database, const DatabaseFormat& format) {
  const auto before = Look(database);
  if (!before) return Fail(before.error());
  if (auto fits = CheckFound(database, format, *before); !fits) return fits;
  if (!before->is_empty() && before->version == format.version()) return {};
  // In a transaction that looks again, so that two processes do not both take the same step.
  return database.Transact(
      "cannot be brought to version " + std::to_string(format.version()), [&]() -> Result<void> {
        const auto found = Look(database);
        if (!found) return Fail(found.error());
        if (auto fits = CheckFound(database, format, *found); !fits) return fits;
        for (auto version = static_cast<std::size_t>(found->version); version < format.steps.size();
             ++version) {
          if (auto done = database.Execute(format.steps[version]); !done) return done;
        }
        return database.Execute("PRAGMA application_id=" + std::to_string(format.application_id) +
                                "; PRAGMA user_version=" + std::to_string(format.version()));
      });
}

Result<void> ExpectFormat(const Database& database, const DatabaseFormat& format) {
  const auto found = Look(database);
  if (!found) return Fail(found.error());
  if (auto fits = CheckFound(database, format, *found); !fits) return fits;
  if (found->application == format.application_id && found->version == format.version()) return {};
  return Fail(ErrorKind::kBadInput, database.path() + ": a " + format.kind + " of version " +
                                        std::to_string(found->version) + ", expected " +
                                        std::to_string(format.version()) +
                                        ": bendloopd brings it there when it starts");
}

}  // namespace bendloop::drivers
