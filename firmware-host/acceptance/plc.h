// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "drivers/register_bender/register_bender.h"
#include "firmware-host/acceptance/frame_log.h"
#include "firmware-host/acceptance/register_program.h"
#include "firmware-host/acceptance/rules.h"
#include "firmware-host/acceptance/timing.h"
#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/register_map.h"

namespace bendloop::host {

// What the PLC shows of itself, as numbers: a code that the map does not name is no error here.
struct PlcState {
  std::uint32_t mode = 0;
  std::uint32_t heartbeat = 0;
  std::uint32_t reply_sequence = 0;
  std::uint32_t reply = 0;
  std::uint32_t reply_code = 0;
  // The PLC was in this state at some moment between these: on a line, or a machine, that is slow
  // they may lie far apart.
  std::chrono::nanoseconds asked_at{0};
  std::chrono::nanoseconds at{0};
};

// An exchange that failed, and the rule that speaks of what was asked.
struct Trouble {
  Rule rule = Rule::kHeartbeat;
  std::string text;
};

// The PLC, register by register. An exchange that fails is kept as trouble(); until that is taken
// every call returns nothing or false, so that a script asks once, at its end. One thread.
class Plc {
 public:
  Plc(hal::RegisterMap map, std::unique_ptr<drivers::RegisterCarrier> carrier, hal::Clock& clock);

  const hal::RegisterMap& map() const { return map_; }
  ProgramForm& form() { return form_; }
  hal::Clock& clock() { return clock_; }
  FrameLog& frames() { return *frames_; }
  const Timing& timing() const { return timing_; }
  // The daemon's own way to the same registers.
  hal::BenderLink& link() { return *link_; }
  // "Modbus TCP 127.0.0.1:502 unit 1".
  std::string Name() const;
  // The largest sequence that all registers hold; the link must have connected.
  std::uint32_t max_sequence() const { return max_sequence_; }
  bool has_heartbeat() const { return has_heartbeat_; }

  bool Connect();
  std::optional<PlcState> State();
  std::optional<RegisterProgram> Active() { return ReadProgram(map_.active, std::nullopt); }
  // Its head alone; no rows.
  std::optional<RegisterProgram> ActiveHead() { return ReadProgram(map_.active, 0); }
  // With so many rows, whatever the row count says.
  std::optional<RegisterProgram> Staged(std::size_t rows) {
    return ReadProgram(map_.staging, rows);
  }
  // All of it, as the driver does.
  bool Stage(const RegisterProgram& program);
  // Some rows of it. A map of objects moves rows from the first one only.
  bool StageRows(const RegisterProgram& program, std::size_t first, std::size_t count);
  bool StageHead(const RegisterProgram& program);
  // The head, a register or pair at a time, the last one first.
  bool StageHeadOneByOne(const RegisterProgram& program);
  bool Commit(std::uint32_t sequence);

  // Does it answer at all, whatever trouble there was?
  bool Answers();
  const std::optional<Trouble>& trouble() const { return trouble_; }
  std::optional<Trouble> TakeTrouble() { return std::exchange(trouble_, std::nullopt); }

  // Since WatchHeartbeat(): how long the heartbeat stood still at most, and its changes.
  void WatchHeartbeat();
  std::chrono::nanoseconds longest_standstill() const { return longest_standstill_; }
  std::size_t beats() const { return beats_; }
  void AddTiming(const std::string& kind, std::chrono::nanoseconds took) {
    timing_.Add(kind, took);
  }

 private:
  bool Read(const std::vector<drivers::RegisterRange>& ranges, Rule rule, const char* kind);
  bool Write(const std::vector<drivers::RegisterRange>& ranges, Rule rule, const char* kind);
  bool Take(Rule rule, hal::Result<void> done);
  // `rows` empty: as many as the row count says.
  std::optional<RegisterProgram> ReadProgram(const hal::ProgramArea& area,
                                             std::optional<std::size_t> rows);
  void SawHeartbeat(const PlcState& state);

  const hal::RegisterMap map_;
  hal::Clock& clock_;
  std::unique_ptr<FrameLog> frames_;
  ProgramForm form_;
  std::unique_ptr<hal::BenderLink> link_;
  drivers::RegisterImage in_;
  drivers::RegisterImage out_;
  Timing timing_;
  std::optional<Trouble> trouble_;
  std::uint32_t max_sequence_ = 0;
  bool has_heartbeat_ = false;
  std::optional<std::uint32_t> heartbeat_;
  std::chrono::nanoseconds beat_at_{0};
  std::chrono::nanoseconds longest_standstill_{0};
  std::size_t beats_ = 0;
};

}  // namespace bendloop::host
