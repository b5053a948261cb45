// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "hal/bend_program.h"
#include "hal/bender_state.h"
#include "hal/cell_report.h"
#include "hal/result.h"

namespace bendloop::hal {

struct BenderInfo {
  std::string description;     // for the log: address, map
  std::size_t max_rows = 0;    // rows that a program may have
  bool atomic_commit = true;   // false: no commit register; a documented weaker guarantee
  bool has_heartbeat = false;  // BenderState::heartbeat is the controller's own
  std::uint32_t max_sequence = 0xFFFFFFFF;  // the largest that the carrier can hold
  bool takes_report = false;                // the PLC reads something of the cell
};

// The words with a bender, without the order in which they must be said: that is the commit
// protocol's business (firmware-host/commit), the same for every carrier. Each call is one bounded
// exchange: it returns within the configured timeouts. Errors are kDevice; after one the next call
// may succeed (the link reconnects by itself).
class BenderLink {
 public:
  virtual ~BenderLink() = default;

  virtual Result<BenderInfo> Connect() = 0;
  virtual Result<BenderState> ReadState() = 0;
  // The program that the bender would bend now, as it holds it. Values come rounded to the
  // carrier's resolution.
  virtual Result<ProgramBlock> ReadActive() = 0;
  // The same, whether or not its crc fits its rows; the crc is the controller's.
  virtual Result<ProgramBlock> ReadActiveAsItStands() { return ReadActive(); }
  // `program` as the carrier would give it back: rounded to its resolution, with the crc that the
  // carrier's encoding gives. kBadInput if a value does not fit (names row and value).
  virtual Result<ProgramBlock> Encode(const ProgramBlock& block) = 0;
  // Writes into the staging area; the active program is untouched.
  virtual Result<void> Stage(const ProgramBlock& block) = 0;
  virtual Result<ProgramBlock> ReadStaged() = 0;
  // One write that makes the staged program with this sequence the active one. The answer comes in
  // BenderState::reply.
  virtual Result<void> Commit(std::uint32_t sequence) = 0;
  // Shows the PLC what it reads of the cell: what has changed since the last call that went well,
  // the sequence after the rest. Does nothing where the PLC reads nothing.
  virtual Result<void> Report(const CellReport& /*report*/) { return {}; }
};

}  // namespace bendloop::hal
