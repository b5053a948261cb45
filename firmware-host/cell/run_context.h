// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/bend_program.h"
#include "hal/result.h"
#include "pipeline/correction/correction.h"
#include "pipeline/correction/interlocks.h"

namespace bendloop::host {

// What a run depends on beside the scan and the cell file. It stands in the session's meta under
// "context", so that a replay of the session gives the result of the live run.
struct RunContext {
  std::optional<hal::ProgramBlock> bent_with;  // the program that bent the tube
  std::optional<pipeline::LotState> lot;       // before this part; empty: the part begins a lot
  std::uint32_t last_sequence = 0;             // last number given to a program sent
  // What the bender must hold for a correction to be its next program; empty: `bent_with`.
  std::optional<hal::ProgramBlock> expected = {};
  std::vector<pipeline::TubeCheck> tube_checks = {};  // what the ledger said of the tube
  std::optional<std::int64_t> tube = {};              // the ledger's id of it
  std::string repeat_of = {};  // the session whose tube it was again; empty: none
};

inline constexpr const char* kContextKey = "context";
// When the scan began, by the wall clock: ISO 8601.
inline constexpr const char* kStartKey = "start";
// When it ended, alike.
inline constexpr const char* kEndKey = "end";

// Whether a session's "start" and "end", as far as it says them, are times that ParseUtc() reads.
// kBadInput; `name` stands for the session in the message.
hal::Result<void> CheckRecordedTimes(const std::map<std::string, std::string>& meta,
                                     std::string_view name);

// JSON, one line, schema "bendloop.context/1"; every number reads back as the same bits.
std::string WriteRunContext(const RunContext& context);
// kBadInput; `name` stands for the session in the message.
hal::Result<RunContext> ReadRunContext(std::string_view text, std::string_view name);

// The same for what a lot has taught, kept from part to part in the state directory. `key` names
// the settings that it was learnt with.
std::string WriteLot(const pipeline::LotState& lot, std::string_view key);
// Empty when the file belongs to another key: a new lot begins.
hal::Result<std::optional<pipeline::LotState>> ReadLot(std::string_view text, std::string_view name,
                                                       std::string_view key);

}  // namespace bendloop::host
