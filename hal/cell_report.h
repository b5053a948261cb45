// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace bendloop::hal {

// What the cell does, as a PLC wants to know it. The numbers are public.
enum class CellState : std::uint8_t {
  kStarting = 0,
  kIdle = 1,        // waits for a scan
  kScanning = 2,    // a scan runs
  kMeasuring = 3,   // it is over, and its result is being worked out
  kCommitting = 4,  // a correction is on its way to the bender
  kHeld = 5,        // as idle, but nothing will be corrected until a hold is taken back
  kFault = 6,       // as idle, but something is to be mended first: the alarm says what
};

enum class TubeVerdict : std::uint8_t {
  kNone = 0,
  kPass = 1,
  kFail = 2,
  kUndecided = 3,
  kHeld = 4,  // not judged, or the judgement is not to be trusted
};

// What the PLC reads of the cell.
struct CellReport {
  std::uint32_t heartbeat = 0;  // counts up while the cell lives
  CellState state = CellState::kStarting;
  std::uint32_t alarm = 0;   // number of the foremost alarm, 1001 for BL1001; 0: none
  std::uint32_t alarms = 0;  // that are active

  // Of the last tube. `sequence` is another one for each; it is written after the rest.
  std::uint32_t sequence = 0;
  TubeVerdict verdict = TubeVerdict::kNone;
  std::uint32_t part_number = 0;
  std::string identity;             // as the PLC gave it; empty: it gave none
  std::uint32_t worst_percent = 0;  // largest deviation, in percent of its tolerance

  // Since the daemon's start.
  std::uint32_t tubes = 0;
  std::uint32_t passed = 0;
  std::uint32_t failed = 0;
  std::uint32_t undecided = 0;
  std::uint32_t held = 0;

  // Told back.
  std::uint32_t part_set = 0;  // the part that the next scan is taken for; 0: none that is known
  std::uint32_t acknowledged = 0;  // what `acknowledge` said when it was done
  std::uint32_t lot_begun = 0;     // what `new_lot` said when it was done

  bool operator==(const CellReport&) const = default;
};

// Numbers are public; any other one is taken for kOver.
enum class ScanOrder : std::uint8_t {
  kNotSaid = 0,  // scans begin and end as the scanner says
  kMayRun = 1,
  kOver = 2,  // none may run; one that runs is complete
};

// What the PLC says to the cell; empty: its map has no such field.
struct PlcOrders {
  std::optional<std::uint32_t> part_number;  // of the tube that is scanned next; 0: the cell file's
  std::optional<std::string> identity;       // of it; printable ASCII, without blanks at its end
  bool identity_is_text = true;              // false: its registers hold something else
  std::optional<ScanOrder> scan;
  std::optional<bool> hold;  // measure, and correct nothing
  // Another number than before, but 0, asks once.
  std::optional<std::uint32_t> new_lot;
  std::optional<std::uint32_t> acknowledge;

  bool operator==(const PlcOrders&) const = default;
};

}  // namespace bendloop::hal
