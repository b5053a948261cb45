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

enum class CommitStep : std::uint8_t {
  kBegun,         // about to stage; nothing sent yet
  kCommitting,    // the commit write may have been sent from here on
  kCommitted,     // the bender was seen holding the new program
  kNotCommitted,  // the bender was seen holding another one, and the commit cannot come late
  kFailed,        // the same, by a failure of link or bender and nobody's refusal
};

inline bool IsEnd(CommitStep step) {
  return step != CommitStep::kBegun && step != CommitStep::kCommitting;
}

// One program on its way to the bender.
struct CommitAttempt {
  std::int64_t id = 0;
  std::string session;     // the scan that the correction came from
  hal::ProgramBlock base;  // active before
  hal::ProgramBlock next;  // as the link encodes it
  CommitStep step = CommitStep::kBegun;
  std::string detail;  // of the last step
};

// How what locks begins where it is no bender's doing (ledger/damaged_journal.h).
inline constexpr const char* kJournalWasDamaged = "the commit journal was damaged and lies now in ";
inline bool IsOfJournal(const std::string& breach) {
  return breach.starts_with(kJournalWasDamaged);
}

// Append-only record of every attempt, flushed to disk at every step (SQLite, WAL,
// synchronous=FULL), so that after a power loss it is known what may have been sent. One process
// at a time. Errors are those of OpenJournalFile() (journal_file.h).
class CommitJournal {
 public:
  // Creates the file if there is none. ":memory:" for tests.
  static hal::Result<CommitJournal> Open(const std::filesystem::path& path);

  // Appends kBegun and returns the attempt's id.
  hal::Result<std::int64_t> Begin(const CommitAttempt& attempt);
  hal::Result<void> Append(std::int64_t attempt, CommitStep step, const std::string& detail);

  // The newest attempt if its last step leaves open which program is active.
  hal::Result<std::optional<CommitAttempt>> Unfinished() const;
  hal::Result<std::optional<CommitAttempt>> Last() const;
  // The attempts after this one that came to their end, the oldest first.
  hal::Result<std::vector<CommitAttempt>> EndsAfter(std::int64_t attempt) const;
  // The newest attempt that came to its end; 0: none.
  hal::Result<std::int64_t> LastEnd() const;
  // Has this session's correction reached the bender? Then its measurement is of an older program.
  hal::Result<bool> SessionCommitted(const std::string& session) const;
  // Was it this journal's own commit that made `to` out of `from`?
  hal::Result<bool> Proposed(const hal::ProgramBlock& from, const hal::ProgramBlock& to) const;
  // 7 when "part-0007" is the last session that the journal knows, whatever the disk still holds.
  hal::Result<unsigned> LargestPartNumber() const;
  // The last sequence number given out; 0: none.
  hal::Result<std::uint32_t> LastSequence() const;
  // Notes a sequence number that was used outside an attempt.
  hal::Result<void> NoteSequence(std::uint32_t sequence);
  // The same for what is staged to be never committed: it makes an earlier commit void.
  hal::Result<void> NoteVoid(std::uint32_t sequence);
  // Was the number given out for this, the last time that it was given out?
  hal::Result<bool> IsVoid(std::uint32_t sequence) const;

  // The bender was seen to break a rule. Each cause counts once, however often it is seen.
  hal::Result<void> NoteBreach(const std::string& cause, const std::string& detail);
  // The first breach since somebody acknowledged, in words; nullopt: none, programs may be sent.
  hal::Result<std::optional<std::string>> OpenBreach() const;
  // Of all breaches so far.
  hal::Result<void> Acknowledge(const std::string& who);

 private:
  explicit CommitJournal(drivers::Database database) : database_(std::move(database)) {}
  drivers::Database database_;
};

}  // namespace bendloop::host
