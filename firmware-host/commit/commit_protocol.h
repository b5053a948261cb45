// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>

#include "firmware-host/commit/commit_facts.h"
#include "firmware-host/commit/commit_journal.h"
#include "hal/bend_program.h"
#include "hal/bender_link.h"
#include "hal/clock.h"

namespace bendloop::host {

struct CommitOptions {
  std::chrono::milliseconds reply_timeout{3000};      // from the commit write to a known end
  std::chrono::milliseconds poll_period{10};          // of the bender's state meanwhile
  std::chrono::milliseconds heartbeat_timeout{2000};  // a heartbeat older than this is dead
  bool allow_non_atomic = false;                      // send to a bender without commit register
};

struct CommitRequest {
  std::string session;       // the scan that the correction came from
  hal::ProgramBlock base;    // the program that bent the part, as read from the bender
  hal::BendProgram program;  // the corrected one
};

enum class CommitOutcome : std::uint8_t {
  kCommitted,  // the new program is active, read back and equal
  kRefused,    // we or the bender declined; the active program is untouched
  kFailed,   // link or bender failed; the new program is not active and cannot become so by itself
  kUnknown,  // the bender cannot be asked: it holds the old or the new program; Resume finds out
  kWaiting,  // not tried to its end: the bender is busy or away; nothing was sent, it is tried
             // again
};

struct CommitReport {
  CommitOutcome outcome = CommitOutcome::kUnknown;
  std::string reason;                       // one line for the setter; empty when committed
  std::uint32_t sequence = 0;               // of the new program; 0 if none was given out
  std::optional<hal::ProgramBlock> active;  // as last read from the bender
  // Refused or failed by nothing but the moment: bender not idle, or no answer before anything was
  // sent. The same request may be made again.
  bool may_be_repeated = false;
  std::optional<CommitFacts> facts = {};  // of a program that was staged at least
  std::int64_t attempt = 0;               // in the journal; 0: none was begun
  std::string breach = {};                // the rule that the bender was seen to break; empty: none
};

const char* Name(CommitOutcome outcome);

// The one way in which a program reaches a bender, whatever the carrier. At every moment, power
// loss included, the bender holds the old or the new program complete, and the journal tells what
// must be asked. The commit of one sequence number is written at most once.
class CommitProtocol {
 public:
  CommitProtocol(hal::BenderLink& link, CommitJournal& journal, hal::Clock& clock,
                 CommitOptions options = {});

  // Tells of a state that somebody read, so that Commit need not wait for the next heartbeat.
  void Observe(const hal::BenderState& state);

  // Blocks until the end is known or the timeouts have passed.
  CommitReport Commit(const CommitRequest& request);

  // Ends an attempt that a crash or a lost link left open; Commit does so by itself. nullopt: there
  // was none.
  // The report's session is in `session`.
  std::optional<CommitReport> Resume(std::string* session = nullptr);

  // Tells of an active program that somebody read: one that was never committed is a breach.
  void ObserveActive(const hal::ProgramBlock& active);

  // After a breach nothing is sent until somebody acknowledges. The breach in words; empty: none.
  std::string Locked() const;
  hal::Result<void> Acknowledge(const std::string& who);

 private:
  using Refusal = std::optional<CommitReport>;  // empty: go on

  Refusal CheckBefore(const CommitRequest& request);
  Refusal CheckAlive(hal::BenderState& state);
  Refusal CheckUnchanged(const hal::ProgramBlock& base);
  Refusal StageAndVerify(const CommitAttempt& attempt);
  hal::Result<std::uint32_t> FreshSequence();
  CommitReport AwaitReply(const CommitAttempt& attempt, std::string why);
  CommitReport Settle(const CommitAttempt& attempt, std::string why,
                      CommitOutcome otherwise = CommitOutcome::kFailed);
  // What it can still be called before the commit was written.
  CommitReport StopBefore(const CommitAttempt& attempt, CommitReport report);
  hal::Result<void> Disarm(const CommitAttempt& attempt);
  CommitReport Finish(const CommitAttempt& attempt, CommitReport report);
  void NoteAnswer(const CommitAttempt& attempt, const hal::BenderState& state);
  // Reads the active program, and compares it with the attempt's.
  hal::Result<hal::ProgramBlock> LookAtActive(const CommitAttempt& attempt);
  void NoteBreach(const std::string& cause, const std::string& breach);

  hal::BenderLink& link_;
  CommitJournal& journal_;
  hal::Clock& clock_;
  CommitOptions options_;
  hal::BenderInfo info_;
  CommitFacts facts_;                // of the attempt that is under way
  std::string lost_breach_;          // that the journal did not take
  std::uint32_t seen_sequence_ = 0;  // of the active program, when somebody looked last
  std::optional<std::uint32_t> last_heartbeat_;
  std::optional<std::chrono::nanoseconds> heartbeat_changed_;
};

// What the journal knows of how an attempt ended.
CommitReport EndOf(const CommitAttempt& attempt);

// The number after all of these that differs from each: their largest plus one, 1 after `max`
// (0 means never set).
std::uint32_t NextSequenceNumber(std::initializer_list<std::uint32_t> used, std::uint32_t max);

// What differs first, "row 3 angle_deg is 45, expected 45.1"; empty: nothing.
std::string FirstDifference(const hal::ProgramBlock& found, const hal::ProgramBlock& expected);

// "part 7, sequence 12, 5 rows, crc 0x1234abcd"
std::string Describe(const hal::ProgramBlock& block);

}  // namespace bendloop::host
