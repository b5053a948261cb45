// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "hal/cell_report.h"

namespace bendloop::hal {

enum class BenderMode : std::uint8_t {
  kNotReady,  // off, homing, setup, guard open
  kIdle,      // ready for a program or a cycle
  kBending,   // a cycle runs: nothing may be written
  kFault,
};

enum class CommitReply : std::uint8_t { kNone, kAccepted, kRejected };

// What the bender says of itself, read in one go.
struct BenderState {
  BenderMode mode = BenderMode::kNotReady;
  std::uint32_t fault_code = 0;
  std::uint32_t heartbeat = 0;           // changes while the controller lives
  std::uint32_t parts_bent = 0;          // counts finished cycles
  std::uint32_t active_part_number = 0;  // of the program it would bend now
  std::uint32_t active_sequence = 0;
  std::uint32_t reply_sequence = 0;  // the commit that `reply` answers
  CommitReply reply = CommitReply::kNone;
  std::uint32_t reply_code = 0;  // the bender's reason for a rejection
  PlcOrders orders = {};         // what the PLC says to the cell
};

}  // namespace bendloop::hal
