// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/sqlite/database.h"
#include "hal/bend_program.h"
#include "hal/result.h"

namespace bendloop::host {

// What became of a scan, in the order in which it may come.
enum class ScanFate : std::uint8_t {
  kHeld,       // measured and refused; its tube may be scanned again
  kUsed,       // its tube is used up: the lot has learnt from it, a correction may follow
  kWaiting,    // a correction of it waits for the bender
  kCorrected,  // a correction of it is active at the bender
  kUnknown,    // whether it is, the bender has not told yet
  kDone,       // nothing more comes of it
};
const char* Name(ScanFate fate);

// A tube as the ledger keeps it.
struct BentTube {
  std::int64_t id = 0;
  std::optional<std::uint32_t> count;        // the bender's, after it was bent; empty: not counted
  std::optional<hal::ProgramBlock> program;  // that bent it; empty: not known, `doubt` says why
  std::uint64_t epoch = 0;                   // foreign changes of the active program before it
  std::string doubt;
  // By the ledger's clock: it was bent between these two; the least for one of an earlier run.
  std::int64_t after_ns = INT64_MIN;
  std::int64_t seen_ns = INT64_MIN;
  bool used = false;    // a scan has used it up, or a later tube's scan has passed it over
  std::string session;  // of that scan
};

// What somebody calls a tube: the PLC, or a code on it. Each part has names of its own.
struct TubeName {
  std::uint32_t part_number = 0;
  std::string name;

  bool operator==(const TubeName&) const = default;
};

// What the bender showed when it last showed something new.
struct BenderChange {
  std::uint32_t parts_bent = 0;
  hal::ProgramBlock active;
  std::uint64_t epoch = 0;
  std::string what;
};

// The ledger's tables in the journal's file (firmware-host/commit): append-only, flushed at every
// call. Errors are those of OpenJournalFile().
class LedgerStore {
 public:
  static hal::Result<LedgerStore> Open(const std::filesystem::path& path);

  // A change and the tubes that it brought, all or none; the tubes are given their ids.
  hal::Result<void> Append(const BenderChange& change, std::vector<BentTube>& tubes);
  // A scan's fate; `tube` where it has one.
  hal::Result<void> Append(const std::string& session, std::optional<std::int64_t> tube,
                           ScanFate fate, const std::string& detail);
  // A scan has used up `tube`, which is called `name`, where it has one.
  hal::Result<void> AppendUse(const std::string& session, std::int64_t tube,
                              const std::string& detail, const std::optional<TubeName>& name);
  // The same of a new tube that only this scan tells of; it is given its id.
  hal::Result<void> AppendUse(const std::string& session, BentTube& tube,
                              const std::optional<TubeName>& name);

  hal::Result<std::optional<BenderChange>> LastChange() const;
  // The newest since (and with) the last jump of the count, at most `count`, oldest first.
  hal::Result<std::vector<BentTube>> Tubes(std::size_t count) const;
  // Sessions whose last fate is `fate`.
  hal::Result<std::vector<std::string>> Sessions(ScanFate fate) const;
  // The latest scan but `session` that has used up a tube of this name.
  hal::Result<std::optional<std::string>> SessionOf(const TubeName& name,
                                                    const std::string& session) const;
  // What the tube is called that `session` has used up.
  hal::Result<std::optional<TubeName>> NameOf(const std::string& session) const;

 private:
  explicit LedgerStore(drivers::Database database) : database_(std::move(database)) {}
  // The row of `program`, new or not.
  hal::Result<std::int64_t> RowOf(const hal::ProgramBlock& program);
  // The tube is given its id.
  hal::Result<void> Insert(BentTube& tube);
  hal::Result<void> InsertUse(const std::string& session, std::int64_t tube,
                              const std::string& detail, const std::optional<TubeName>& name);

  drivers::Database database_;
};

// How the doubt of the first tube after a jump begins: what lies before it tells nothing any more.
inline constexpr const char* kCountJumped = "the bender's count of tubes jumped";

}  // namespace bendloop::host
