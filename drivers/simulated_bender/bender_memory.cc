// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/bender_memory.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::drivers {
namespace {

bool AllSet(const std::vector<bool>& set, const RegisterRange& range) {
  if (range.count == 0 || range.address + range.count > set.size()) return false;
  const auto first = set.begin() + range.address;
  return std::all_of(first, first + range.count, [](bool known) { return known; });
}

bool Overlap(const RegisterRange& a, const RegisterRange& b) {
  return a.space == b.space && a.address < b.address + b.count && b.address < a.address + a.count;
}

}  // namespace

BenderMemory::BenderMemory(hal::RegisterMap map) : map_(std::move(map)) {
  std::vector<RegisterRange> known{RangeOf(map_.mode), RangeOf(map_.reply_sequence),
                                   RangeOf(map_.reply)};
  for (const auto* field :
       {&map_.fault_code, &map_.heartbeat, &map_.parts_bent, &map_.reply_code}) {
    if (*field) known.push_back(RangeOf(**field));
  }
  std::vector<RegisterRange> ours = HeadRanges(map_.staging);
  ours.push_back(RowsRange(map_, map_.staging, map_.max_rows));
  if (map_.commit) ours.push_back(RangeOf(*map_.commit));
  for (const RegisterRange& range : HeadRanges(map_.active)) known.push_back(range);
  known.push_back(RowsRange(map_, map_.active, map_.max_rows));

  for (auto& space : readable_) space.assign(kAddressSpaceSize, false);
  writable_.assign(kAddressSpaceSize, false);
  for (const RegisterRange& range : ours) {
    std::fill_n(writable_.begin() + range.address, range.count, true);
    known.push_back(range);
  }
  for (const RegisterRange& range : known) {
    auto& space = readable_[range.space == hal::RegisterSpace::kHolding ? 0 : 1];
    std::fill_n(space.begin() + range.address, range.count, true);
  }
}

hal::Result<void> BenderMemory::LoadActive(const hal::ProgramBlock& block) {
  return EncodeProgram(map_, map_.active, block, image_);
}

hal::Result<hal::ProgramBlock> BenderMemory::Active() const {
  return DecodeProgram(map_, map_.active, image_);
}

hal::Result<hal::ProgramBlock> BenderMemory::Staged() const {
  return DecodeProgram(map_, map_.staging, image_);
}

bool BenderMemory::CanRead(const RegisterRange& range) const {
  return AllSet(readable_[range.space == hal::RegisterSpace::kHolding ? 0 : 1], range);
}

bool BenderMemory::CanWrite(const RegisterRange& range) const {
  return range.space == hal::RegisterSpace::kHolding && AllSet(writable_, range);
}

void BenderMemory::Put(const hal::RegisterField& field, std::uint32_t value) {
  // A counter wraps within what its register can hold.
  const std::uint64_t size = std::uint64_t{MaxInteger(field)} + 1;
  (void)PutField(map_, field, static_cast<double>(value % size), "state", image_);
}

bool BenderMemory::AfterWrite(const RegisterRange& range) {
  if (map_.commit) {
    return Overlap(range, RangeOf(*map_.commit)) &&
           GetInteger(map_, *map_.commit, "commit", image_).value_or(0) != 0;
  }
  // The bad old PLC: what has been written is what it bends.
  const bool same_place = map_.staging.rows_address == map_.active.rows_address &&
                          map_.staging.rows_space == map_.active.rows_space;
  if (!same_place && Overlap(range, RangeOf(map_.staging.row_count))) {
    const auto staged = Staged();
    if (staged && !staged->program.rows.empty()) Activate(*staged);
  }
  return false;
}

RejectCode BenderMemory::Judge(std::uint32_t sequence, hal::ProgramBlock& staged) const {
  if (mode_ != hal::BenderMode::kIdle) return RejectCode::kNotIdle;
  const auto count = GetInteger(map_, map_.staging.row_count, "row_count", image_);
  if (!count || *count < 2 || *count > map_.max_rows) return RejectCode::kRowCount;
  const auto decoded = Staged();
  if (!decoded) return RejectCode::kValue;
  staged = *decoded;
  if (staged.sequence != sequence) return RejectCode::kSequence;
  if (staged.crc !=
      ProgramCrc(map_, map_.staging, staged.part_number, staged.sequence, *count, image_)) {
    return RejectCode::kCrc;
  }
  const auto active = Active();
  if (active && active->sequence == sequence) return RejectCode::kNotNew;
  if (active && active->part_number != staged.part_number) return RejectCode::kOtherPart;
  constexpr double kTurnDeg = 360;
  for (const hal::BendRow& row : staged.program.rows) {
    if (row.length_mm < 0 || row.angle_deg < 0 || row.angle_deg >= kTurnDeg) {
      return RejectCode::kValue;
    }
  }
  if (staged.program.rows.back().angle_deg != 0) return RejectCode::kValue;
  return RejectCode::kNone;
}

void BenderMemory::HandleCommit(std::uint32_t forced_code) {
  const std::uint32_t sequence = GetInteger(map_, *map_.commit, "commit", image_).value_or(0);
  hal::ProgramBlock staged;
  auto code = static_cast<RejectCode>(forced_code);
  if (code == RejectCode::kNone) code = Judge(sequence, staged);
  if (code == RejectCode::kNone) {
    Activate(staged);
    Put(map_.staging.sequence, 0);  // used up: a repeated commit finds nothing
  }
  code == RejectCode::kNone ? ++accepted_ : ++rejected_;
  Reply(sequence, code);
}

void BenderMemory::Activate(const hal::ProgramBlock& staged) {
  const RegisterRange from = RowsRange(map_, map_.staging, staged.program.rows.size());
  std::copy_n(image_.At(from.space, map_.staging.rows_address), from.count,
              image_.At(map_.active.rows_space, map_.active.rows_address));
  Put(map_.active.part_number, staged.part_number);
  Put(map_.active.sequence, staged.sequence);
  Put(map_.active.row_count, static_cast<std::uint32_t>(staged.program.rows.size()));
  Put(map_.active.crc, staged.crc);
}

void BenderMemory::Reply(std::uint32_t sequence, RejectCode code) {
  if (map_.reply_code) Put(*map_.reply_code, static_cast<std::uint32_t>(code));
  Put(map_.reply, code == RejectCode::kNone ? map_.reply_accepted : map_.reply_rejected);
  Put(map_.reply_sequence, sequence);
}

void BenderMemory::SetState(const hal::BenderState& state) {
  mode_ = state.mode;
  const std::uint32_t modes[] = {map_.mode_not_ready, map_.mode_idle, map_.mode_bending,
                                 map_.mode_fault};
  Put(map_.mode, modes[static_cast<int>(state.mode)]);
  if (map_.fault_code) Put(*map_.fault_code, state.fault_code);
  if (map_.heartbeat) Put(*map_.heartbeat, state.heartbeat);
  if (map_.parts_bent) Put(*map_.parts_bent, state.parts_bent);
}

void BenderMemory::ClearVolatile() {
  std::vector<RegisterRange> ranges = HeadRanges(map_.staging);
  ranges.push_back(RowsRange(map_, map_.staging, map_.max_rows));
  for (const auto* field : {&map_.commit, &map_.reply_code}) {
    if (*field) ranges.push_back(RangeOf(**field));
  }
  ranges.push_back(RangeOf(map_.reply));
  ranges.push_back(RangeOf(map_.reply_sequence));
  if (!map_.commit) ranges.clear();  // staging may be the active program itself
  for (const RegisterRange& range : ranges) {
    std::fill_n(image_.At(range.space, static_cast<std::uint16_t>(range.address)), range.count,
                std::uint16_t{0});
  }
}

void BenderMemory::SetActiveRowCount(std::uint32_t rows) { Put(map_.active.row_count, rows); }

}  // namespace bendloop::drivers
