// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/bender_memory.h"

#include <algorithm>
#include <chrono>
#include <iterator>
#include <optional>
#include <utility>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/plc_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "drivers/simulated_bender/spoiled_rows.h"

namespace bendloop::drivers {
namespace {

using M = RuleMutant;

// How late mutants are: within every reply timeout, and beyond it.
constexpr std::chrono::milliseconds kLate{400};
constexpr std::chrono::milliseconds kTooLate{4000};
constexpr std::uint32_t kLow15Bits = 0x7fff;

bool AllSet(const std::vector<bool>& set, const RegisterRange& range) {
  if (range.count == 0 || range.address + range.count > set.size()) return false;
  const auto first = set.begin() + range.address;
  return std::all_of(first, first + range.count, [](bool known) { return known; });
}

bool Overlap(const RegisterRange& a, const RegisterRange& b) {
  return a.space == b.space && a.address < b.address + b.count && b.address < a.address + a.count;
}

}  // namespace

BenderMemory::BenderMemory(hal::RegisterMap map) : promised_(std::move(map)), map_(promised_) {
  std::vector<RegisterRange> known{RangeOf(map_.mode), RangeOf(map_.reply_sequence),
                                   RangeOf(map_.reply)};
  for (const auto* field :
       {&map_.fault_code, &map_.heartbeat, &map_.parts_bent, &map_.reply_code}) {
    if (*field) known.push_back(RangeOf(**field));
  }
  std::vector<RegisterRange> ours = HeadRanges(map_.staging);
  ours.push_back(RowsRange(map_, map_.staging, map_.max_rows));
  if (map_.commit) ours.push_back(RangeOf(*map_.commit));
  for (const RegisterRange& range : ReportRanges(map_.report)) ours.push_back(range);
  for (const RegisterRange& range : ReportSequenceRanges(map_.report)) ours.push_back(range);
  for (const RegisterRange& range : OrderRanges(map_.orders)) known.push_back(range);
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

void BenderMemory::Break(const RuleMutantSet& mutants) {
  const auto active = Active();
  const bool words = Breaks(M::kSwapsWords), bytes = Breaks(M::kSwapsBytes);
  mutants_ = mutants;
  if (words == Breaks(M::kSwapsWords) && bytes == Breaks(M::kSwapsBytes)) return;
  map_.high_word_first = promised_.high_word_first != Breaks(M::kSwapsWords);
  map_.high_byte_first = promised_.high_byte_first != Breaks(M::kSwapsBytes);
  if (active) (void)LoadActive(*active);
}

std::vector<BenderMemory::Later> BenderMemory::TakeLater() { return std::exchange(later_, {}); }

hal::Result<void> BenderMemory::LoadActive(const hal::ProgramBlock& block) {
  return EncodeProgram(map_, map_.active, block, image_);
}

hal::Result<void> BenderMemory::EditActive(double add_deg) {
  auto block = Active();
  if (!block) return hal::Fail(block.error());
  if (block->program.rows.empty()) {
    return hal::Fail(hal::ErrorKind::kDevice, "no program is active: nothing to edit");
  }
  const Head before = HeadOf(map_.active);
  block->program.rows.front().angle_deg += add_deg;
  const bool keeps_sequence = Breaks(M::kEditKeepsCrc) || Breaks(M::kEditClearsCrcOnly);
  if (!keeps_sequence) block->sequence = 0;
  if (auto ok = LoadActive(*block); !ok) return ok;
  if (Breaks(M::kOtherCrc)) Put(map_.active.crc, CrcOf(map_.active, HeadOf(map_.active)));
  if (Breaks(M::kEditKeepsCrc)) Put(map_.active.crc, before.crc);
  if (Breaks(M::kEditClearsCrcOnly)) Put(map_.active.crc, 0);
  return {};
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
  if (range.space != hal::RegisterSpace::kHolding || !AllSet(writable_, range)) return false;
  if (takes_report_) return true;
  std::vector<RegisterRange> report = ReportRanges(map_.report);
  for (const RegisterRange& last : ReportSequenceRanges(map_.report)) report.push_back(last);
  return std::none_of(report.begin(), report.end(),
                      [&](const RegisterRange& field) { return Overlap(range, field); });
}

void BenderMemory::Say(const hal::PlcOrders& orders) { EncodeOrders(map_, orders, image_); }

hal::Result<hal::CellReport> BenderMemory::Heard() const { return DecodeReport(map_, image_); }

void BenderMemory::Put(const hal::RegisterField& field, std::uint32_t value) {
  // A counter wraps within what its register can hold.
  const std::uint64_t size = std::uint64_t{MaxInteger(field)} + 1;
  (void)PutField(map_, field, static_cast<double>(value % size), "state", image_);
}

std::uint32_t BenderMemory::Get(const hal::RegisterField& field) const {
  return GetInteger(map_, field, "", image_).value_or(0);
}

std::uint32_t BenderMemory::Kept(std::uint32_t sequence) const {
  return Breaks(M::kSequence15Bits) ? sequence & kLow15Bits : sequence;
}

BenderMemory::Head BenderMemory::HeadOf(const hal::ProgramArea& area) const {
  return {Get(area.part_number), Get(area.sequence), Get(area.row_count), Get(area.crc)};
}

std::uint32_t BenderMemory::CrcOf(const hal::ProgramArea& area, const Head& head) const {
  const std::uint32_t crc =
      ProgramCrc(map_, area, head.part_number, head.sequence, head.row_count, image_);
  return Breaks(M::kOtherCrc) ? ~crc : crc;
}

bool BenderMemory::AfterWrite(const RegisterRange& range) {
  const RegisterRange rows = RowsRange(map_, map_.staging, map_.max_rows);
  if (Overlap(range, rows)) SpoilRows(map_, map_.staging, mutants_, image_);
  if (map_.commit) {
    if (!Overlap(range, RangeOf(*map_.commit))) {
      if (Breaks(M::kActivatesOnStaging) &&
          Judge(Get(map_.staging.sequence)) == RejectCode::kNone) {
        Activate();
      }
      return false;
    }
    const std::uint32_t value = Get(*map_.commit);
    const bool changed = std::exchange(last_commit_, value) != value;
    return (changed || Breaks(M::kActsWithoutChange)) && (value != 0 || Breaks(M::kActsOnZero));
  }
  // The bad old PLC: what has been written is what it bends.
  const bool same_place = map_.staging.rows_address == map_.active.rows_address &&
                          map_.staging.rows_space == map_.active.rows_space;
  if (!same_place && Overlap(range, RangeOf(map_.staging.row_count))) {
    const auto staged = Staged();
    if (staged && !staged->program.rows.empty()) Activate();
  }
  return false;
}

bool BenderMemory::ValuesFit() const {
  const auto staged = Staged();
  if (!staged || staged->program.rows.empty()) return staged.has_value();
  constexpr double kTurnDeg = 360;
  for (const hal::BendRow& row : staged->program.rows) {
    if (row.length_mm < 0 || row.angle_deg < 0 || row.angle_deg >= kTurnDeg) return false;
  }
  return staged->program.rows.back().angle_deg == 0;
}

RejectCode BenderMemory::Judge(std::uint32_t sequence) const {
  const Head staged = HeadOf(map_.staging);
  const bool too_many = staged.row_count > map_.max_rows;
  const auto active = Active();
  const struct {
    bool violated;
    M unchecked;
    RejectCode code;
  } checks[] = {
      {mode_ != hal::BenderMode::kIdle, M::kTakesWhenNotIdle, RejectCode::kNotIdle},
      {staged.row_count < 2, M::kTakesTooFewRows, RejectCode::kRowCount},
      {too_many, M::kTakesTooManyRows, RejectCode::kRowCount},
      {Kept(staged.sequence) != Kept(sequence), M::kTakesWrongSequence, RejectCode::kSequence},
      {!too_many && staged.crc != CrcOf(map_.staging, staged), M::kTakesWrongCrc, RejectCode::kCrc},
      {active && active->sequence == Kept(staged.sequence), M::kTakesActiveSequence,
       RejectCode::kNotNew},
      {active && active->part_number != staged.part_number, M::kTakesOtherPart,
       RejectCode::kOtherPart},
      {!too_many && !ValuesFit(), M::kTakesBeyondLimits, RejectCode::kValue},
  };
  if (Breaks(M::kTakesAnything)) return RejectCode::kNone;
  for (const auto& check : checks) {
    if (check.violated && !Breaks(check.unchecked)) return check.code;
  }
  const bool smaller = active && staged.sequence < active->sequence;
  if (smaller && Breaks(M::kRefusesSmallerSequence)) return RejectCode::kNotNew;
  return Breaks(M::kRejectsEverything) ? RejectCode::kValue : RejectCode::kNone;
}

void BenderMemory::HandleCommit(std::uint32_t forced_code) {
  std::uint32_t sequence = Get(*map_.commit);
  if (sequence == 0 && Breaks(M::kActsOnZero)) sequence = Get(map_.staging.sequence);
  if (Breaks(M::kActivatesLate)) {
    return After(kTooLate, [=](BenderMemory& late) { late.Decide(sequence, forced_code); });
  }
  Decide(sequence, forced_code);
}

void BenderMemory::Decide(std::uint32_t sequence, std::uint32_t forced_code) {
  auto code = static_cast<RejectCode>(forced_code);
  if (code == RejectCode::kNone) code = Judge(sequence);
  code == RejectCode::kNone ? ++accepted_ : ++rejected_;
  if (code == RejectCode::kNone) {
    if (CommitWrongly(sequence)) return;
    Activate();
    UseUp();
  }
  Reply(sequence, code);
}

bool BenderMemory::CommitWrongly(std::uint32_t sequence) {
  if (Breaks(M::kRejectsAndActivates)) {
    Activate();
    UseUp();
    Reply(sequence, RejectCode::kValue);
  } else if (Breaks(M::kRejectsAndActivatesLate)) {
    After(kTooLate, [](BenderMemory& late) { late.Activate(); });
    Reply(sequence, RejectCode::kValue);
  } else if (Breaks(M::kCopiesNothing)) {
    UseUp();
    Reply(sequence, RejectCode::kNone);
  } else if (Breaks(M::kAnswersBeforeCopying)) {
    Reply(sequence, RejectCode::kNone);
    After(kLate, [](BenderMemory& late) {
      late.Activate();
      late.UseUp();
    });
  } else if (Breaks(M::kCopiesInTwoScans)) {
    const std::size_t rows = HeadOf(map_.staging).row_count;
    std::vector<std::uint16_t> kept;  // the second half as it was
    const RegisterRange range = RowsRange(map_, map_.active, rows);
    const std::uint16_t* from =
        image_.At(range.space, static_cast<std::uint16_t>(range.address)) + range.count / 2;
    kept.assign(from, from + (range.count - range.count / 2));
    Activate();
    std::copy(kept.begin(), kept.end(),
              image_.At(range.space, static_cast<std::uint16_t>(range.address)) + range.count / 2);
    After(kLate, [sequence, rows](BenderMemory& late) {
      late.CopyRows(0, rows);
      late.UseUp();
      late.Reply(sequence, RejectCode::kNone);
    });
  } else {
    return false;
  }
  return true;
}

void BenderMemory::CopyRows(std::size_t first, std::size_t end) {
  if (first >= end) return;
  const RegisterRange from = RowsRange(map_, map_.staging, end - first);
  const auto skipped = static_cast<std::uint16_t>(first * map_.row_stride);
  std::copy_n(
      image_.At(from.space, static_cast<std::uint16_t>(map_.staging.rows_address + skipped)),
      from.count,
      image_.At(map_.active.rows_space,
                static_cast<std::uint16_t>(map_.active.rows_address + skipped)));
}

void BenderMemory::Activate() {
  if (auto now = Active()) older_ = *now;
  Head head = HeadOf(map_.staging);
  const std::uint32_t rows = std::min<std::uint32_t>(head.row_count, map_.max_rows);
  const bool cut = rows != std::exchange(head.row_count, rows);
  CopyRows(0, Breaks(M::kCopiesAllButLastRow) && rows > 0 ? rows - 1 : rows);
  const bool bent = Breaks(M::kCopiesRowWrong) || Breaks(M::kCopiesRowWrongKeepsCrc);
  if (bent) BendFirstRow(map_, map_.active, image_);
  head.sequence = Breaks(M::kCopiesOldSequence) ? Get(map_.active.sequence) : Kept(head.sequence);
  if (cut || Breaks(M::kCopiesRowWrong) || Breaks(M::kCopiesOldSequence)) {
    head.crc = CrcOf(map_.active, head);
  }
  Put(map_.active.part_number, head.part_number);
  Put(map_.active.sequence, head.sequence);
  Put(map_.active.row_count, head.row_count);
  Put(map_.active.crc, head.crc);
}

// A repeated commit finds nothing.
void BenderMemory::UseUp() {
  if (!Breaks(M::kKeepsStaged)) Put(map_.staging.sequence, 0);
}

void BenderMemory::Reply(std::uint32_t sequence, RejectCode code) {
  if (Breaks(M::kAnswersNothing)) return;
  const bool accepted = code == RejectCode::kNone || Breaks(M::kCallsRejectedAccepted);
  const auto answer = [accepted, code](BenderMemory& bender) {
    const hal::RegisterMap& map = bender.map_;
    if (map.reply_code) bender.Put(*map.reply_code, static_cast<std::uint32_t>(code));
    bender.Put(map.reply, accepted ? map.reply_accepted : map.reply_rejected);
  };
  Breaks(M::kReplySequenceFirst) ? After(kLate, answer) : answer(*this);
  Put(map_.reply_sequence, Kept(sequence) + (Breaks(M::kAnswersOtherSequence) ? 1 : 0));
}

void BenderMemory::SetState(const hal::BenderState& state) {
  mode_ = state.mode;
  auto shown = state.mode;
  if ((shown == hal::BenderMode::kBending && Breaks(M::kIdleWhileBending)) ||
      (shown == hal::BenderMode::kNotReady && Breaks(M::kIdleWhenNotReady))) {
    shown = hal::BenderMode::kIdle;
  }
  const std::uint32_t modes[] = {map_.mode_not_ready, map_.mode_idle, map_.mode_bending,
                                 map_.mode_fault};
  std::uint32_t number = modes[static_cast<int>(shown)];
  if (shown == hal::BenderMode::kIdle && Breaks(M::kUnnamedMode)) {
    number = 1 + *std::max_element(std::begin(modes), std::end(modes));
  }
  Put(map_.mode, number);
  if (map_.fault_code) Put(*map_.fault_code, state.fault_code);
  if (map_.heartbeat) Put(*map_.heartbeat, state.heartbeat);
  if (map_.parts_bent) Put(*map_.parts_bent, state.parts_bent);
}

void BenderMemory::ClearVolatile() {
  if (Breaks(M::kActivatesStagedAtPowerUp)) Activate();
  if (Breaks(M::kForgetsActive)) SetActiveRowCount(0);
  if (Breaks(M::kRestoresOlderProgram) && older_) (void)LoadActive(*older_);
  later_.clear();
  last_commit_ = 0;
  std::vector<RegisterRange> ranges = HeadRanges(map_.staging);
  ranges.push_back(RowsRange(map_, map_.staging, map_.max_rows));
  for (const auto* field : {&map_.commit, &map_.reply_code}) {
    if (*field) ranges.push_back(RangeOf(**field));
  }
  ranges.push_back(RangeOf(map_.reply));
  ranges.push_back(RangeOf(map_.reply_sequence));
  if (!map_.commit) ranges.clear();  // staging may be the active program itself
  for (const RegisterRange& range : ReportRanges(map_.report)) ranges.push_back(range);
  for (const RegisterRange& range : ReportSequenceRanges(map_.report)) ranges.push_back(range);
  for (const RegisterRange& range : ranges) {
    std::fill_n(image_.At(range.space, static_cast<std::uint16_t>(range.address)), range.count,
                std::uint16_t{0});
  }
}

void BenderMemory::SetActiveRowCount(std::uint32_t rows) { Put(map_.active.row_count, rows); }

}  // namespace bendloop::drivers
