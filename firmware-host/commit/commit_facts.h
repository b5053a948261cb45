// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "hal/bend_program.h"
#include "hal/bender_state.h"

namespace bendloop::host {

// What the active program is, compared with the one that was sent.
enum class ReadBack : std::uint8_t {
  kNotRead,
  kAsSent,
  kOld,      // the one before, unchanged
  kSpoiled,  // ours by its number or its rows, but not as it was sent
  kVoid,     // one that was staged to be never committed
  kOther,    // somebody else's
};

// What a bender did with one program, as it was seen: four facts that a good bender never lets
// contradict one another.
struct CommitFacts {
  bool committed = false;                             // the commit may have been written
  hal::CommitReply answer = hal::CommitReply::kNone;  // accepted or rejected, to this number
  std::uint32_t reply_code = 0;                       // of a rejection
  bool activated = false;       // the active program became ours, as sent or not
  bool answered_early = false;  // accepted was read, and after it the old program was active still
  ReadBack read_back = ReadBack::kNotRead;
  std::string difference;  // of the active program from the one sent; empty: none
};

// "answer: accepted; activated: yes; read back: row 3 angle_deg is 45, expected 45.1"
std::string Describe(const CommitFacts& facts);

// The rule of drivers/README.md that these facts prove broken, and how; empty: none.
std::string ProvenBreach(const CommitFacts& facts);

// Notes what the active program is. `is_void`: its number was given to nothing that was committed.
void NoteActive(const hal::ProgramBlock& active, const hal::ProgramBlock& base,
                const hal::ProgramBlock& sent, bool is_void, CommitFacts& facts);

}  // namespace bendloop::host
