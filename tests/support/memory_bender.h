// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "drivers/simulated_bender/bender_memory.h"
#include "hal/bender_link.h"
#include "tests/support/bender_maps.h"

namespace bendloop::test {

// A bender without a network: the simulated PLC's registers behind a link that never fails by
// itself. Counts what was done to it.
class MemoryBender final : public hal::BenderLink {
 public:
  explicit MemoryBender(const hal::RegisterMap& map, const hal::ProgramBlock& active)
      : memory_(map) {
    (void)memory_.LoadActive(active);
  }

  hal::Result<hal::BenderInfo> Connect() override {
    hal::BenderInfo info;
    info.description = "memory";
    info.max_rows = map().max_rows;
    info.atomic_commit = map().commit.has_value();
    info.has_heartbeat = true;
    info.max_sequence = drivers::MaxInteger(map().staging.sequence);
    return info;
  }

  hal::Result<hal::BenderState> ReadState() override {
    if (!frozen) ++state_.heartbeat;
    hal::BenderState state = state_;
    const auto active = memory_.Active();
    if (!active) return hal::Fail(active.error());
    state.active_part_number = active->part_number;
    state.active_sequence = active->sequence;
    state.reply_sequence = Get(map().reply_sequence);
    const std::uint32_t reply = Get(map().reply);
    if (reply == map().reply_accepted) state.reply = hal::CommitReply::kAccepted;
    if (reply == map().reply_rejected) state.reply = hal::CommitReply::kRejected;
    if (map().reply_code) state.reply_code = Get(*map().reply_code);
    return state;
  }

  hal::Result<hal::ProgramBlock> ReadActive() override { return memory_.Active(); }

  hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
    drivers::RegisterImage image;
    if (auto ok = drivers::EncodeProgram(map(), map().staging, block, image); !ok) {
      return hal::Fail(ok.error());
    }
    return drivers::DecodeProgram(map(), map().staging, image);
  }

  hal::Result<void> Stage(const hal::ProgramBlock& block) override {
    staged_rows_ = static_cast<std::uint32_t>(block.program.rows.size());
    auto ok = drivers::EncodeProgram(map(), map().staging, block, memory_.image());
    if (ok && !map().commit) Put(map().staging.row_count, 0);
    if (ok && map().commit) {
      (void)memory_.AfterWrite(drivers::RowsRange(map(), map().staging, map().max_rows));
    }
    if (ok && after_stage) after_stage();
    return ok;
  }

  // The link breaks after the first half of the rows.
  void StageHalf(const hal::ProgramBlock& block) {
    const auto rows = drivers::RowsRange(map(), map().staging, block.program.rows.size());
    const auto* from =
        memory_.image().At(rows.space, static_cast<std::uint16_t>(rows.address)) + rows.count / 2;
    const std::vector<std::uint16_t> tail(from, from + rows.count - rows.count / 2);
    (void)Stage(block);
    std::copy(
        tail.begin(), tail.end(),
        memory_.image().At(rows.space, static_cast<std::uint16_t>(rows.address)) + rows.count / 2);
  }

  hal::Result<hal::ProgramBlock> ReadStaged() override {
    if (map().commit) return memory_.Staged();
    Put(map().staging.row_count, staged_rows_);
    auto block = memory_.Staged();
    Put(map().staging.row_count, 0);
    return block;
  }

  hal::Result<void> Commit(std::uint32_t sequence) override {
    ++commits_[sequence];
    if (!map().commit) {
      Put(map().staging.row_count, staged_rows_);
      return {};
    }
    Deliver(sequence);
    return {};
  }

  // The PLC sees the commit.
  void Deliver(std::uint32_t sequence) {
    Put(*map().commit, sequence);
    memory_.SetState(state_);
    if (memory_.AfterWrite(drivers::RangeOf(*map().commit))) memory_.HandleCommit(reject_code);
  }

  // What mutants put off is done when its time has come.
  void Pass(std::chrono::nanoseconds now) {
    for (auto& later : memory_.TakeLater()) deeds_.push_back({now + later.after, later.deed});
    for (std::size_t i = 0; i < deeds_.size();) {
      if (deeds_[i].first > now) {
        ++i;
        continue;
      }
      const auto deed = std::move(deeds_[i].second);
      deeds_.erase(deeds_.begin() + static_cast<std::ptrdiff_t>(i));
      memory_.SetState(state_);
      deed(memory_);
    }
  }
  void Reboot() { memory_.ClearVolatile(); }
  void SetMode(hal::BenderMode mode) { state_.mode = mode; }
  void CountTube() { ++state_.parts_bent; }
  hal::ProgramBlock Active() const { return memory_.Active().value(); }
  void LoadActive(const hal::ProgramBlock& block) { (void)memory_.LoadActive(block); }
  drivers::BenderMemory& memory() { return memory_; }
  // How often the commit of each sequence was written.
  std::map<std::uint32_t, int>& commits() { return commits_; }

  bool frozen = false;
  std::function<void()> after_stage;  // what the PLC does with what it was given
  std::uint32_t reject_code = 0;

 private:
  const hal::RegisterMap& map() const { return memory_.map(); }
  std::uint32_t Get(const hal::RegisterField& field) {
    return drivers::GetInteger(map(), field, "state", memory_.image()).value_or(0);
  }
  void Put(const hal::RegisterField& field, std::uint32_t value) {
    (void)drivers::PutField(map(), field, value, "state", memory_.image());
  }

  drivers::BenderMemory memory_;
  std::vector<std::pair<std::chrono::nanoseconds, std::function<void(drivers::BenderMemory&)>>>
      deeds_;
  hal::BenderState state_{.mode = hal::BenderMode::kIdle};
  std::uint32_t staged_rows_ = 0;
  std::map<std::uint32_t, int> commits_;
};

}  // namespace bendloop::test
