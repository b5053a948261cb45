// SPDX-License-Identifier: Apache-2.0
#include "drivers/register_bender/register_bender.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/plc_codec.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;

std::string Crc(std::uint32_t crc) {
  char text[16];
  std::snprintf(text, sizeof text, "0x%08x", crc);
  return text;
}

class RegisterBender final : public hal::BenderLink {
 public:
  RegisterBender(hal::RegisterMap map, std::unique_ptr<RegisterCarrier> carrier)
      : map_(std::move(map)), carrier_(std::move(carrier)) {}

  hal::Result<hal::BenderInfo> Connect() override {
    if (auto ok = CheckRegisterMap(map_); !ok) return hal::Fail(ok.error());
    if (auto ok = carrier_->Connect(); !ok) return hal::Fail(ok.error());
    hal::BenderInfo info;
    info.description =
        carrier_->carrier() + " " + carrier_->peer() + ", register map \"" + map_.name + "\"";
    info.max_rows = map_.max_rows;
    info.atomic_commit = map_.commit.has_value();
    info.has_heartbeat = map_.heartbeat || carrier_->signs().heartbeat;
    info.max_sequence =
        std::min({MaxInteger(map_.active.sequence), MaxInteger(map_.staging.sequence),
                  MaxInteger(map_.reply_sequence)});
    if (map_.commit) info.max_sequence = std::min(info.max_sequence, MaxInteger(*map_.commit));
    info.takes_report = !ReportRanges(map_.report).empty() || map_.report.sequence;
    return info;
  }

  hal::Result<hal::BenderState> ReadState() override {
    if (auto ok = Read(StateRanges()); !ok) return hal::Fail(ok.error());
    hal::BenderState state;
    std::uint32_t mode = 0;
    std::uint32_t reply = 0;
    const std::pair<const hal::RegisterField*, std::pair<std::uint32_t*, const char*>> fields[] = {
        {&map_.mode, {&mode, "mode"}},
        {Optional(map_.fault_code), {&state.fault_code, "fault_code"}},
        {Optional(map_.heartbeat), {&state.heartbeat, "heartbeat"}},
        {Optional(map_.parts_bent), {&state.parts_bent, "parts_bent"}},
        {&map_.active.part_number, {&state.active_part_number, "active part_number"}},
        {&map_.active.sequence, {&state.active_sequence, "active sequence"}},
        {&map_.reply_sequence, {&state.reply_sequence, "reply_sequence"}},
        {&map_.reply, {&reply, "reply"}},
        {Optional(map_.reply_code), {&state.reply_code, "reply_code"}}};
    for (const auto& [field, target] : fields) {
      if (field == nullptr) continue;
      const auto value = GetInteger(map_, *field, target.second, image_);
      if (!value) return hal::Fail(Named(value.error()));
      *target.first = *value;
    }
    const RegisterCarrier::Signs signs = carrier_->signs();
    if (!map_.heartbeat) state.heartbeat = signs.heartbeat.value_or(0);
    if (!map_.fault_code) state.fault_code = signs.fault_code.value_or(0);
    if (mode == map_.mode_idle) {
      state.mode = hal::BenderMode::kIdle;
    } else if (mode == map_.mode_bending) {
      state.mode = hal::BenderMode::kBending;
    } else if (mode == map_.mode_fault) {
      state.mode = hal::BenderMode::kFault;
    } else if (mode != map_.mode_not_ready) {
      return hal::Fail(Named(
          {ErrorKind::kDevice, "mode: " + PlaceOf(map_.mode) + " holds " + std::to_string(mode) +
                                   ", which register map \"" + map_.name + "\" does not name"}));
    }
    auto orders = DecodeOrders(map_, image_);
    if (!orders) return hal::Fail(Named(orders.error()));
    state.orders = std::move(*orders);
    if (reply == map_.reply_accepted) state.reply = hal::CommitReply::kAccepted;
    if (reply == map_.reply_rejected) state.reply = hal::CommitReply::kRejected;
    return state;
  }

  hal::Result<hal::ProgramBlock> ReadActive() override {
    auto block = ReadProgram(map_.active, 0);
    if (!block) return block;
    if (block->program.rows.empty()) return block;
    const std::uint32_t crc = CrcOf(map_.active, *block);
    // A program keyed in at the machine may have no crc; one of ours always has.
    const bool keyed_in = block->sequence == 0 && block->crc == 0;
    if (!keyed_in && block->crc != crc) {
      return hal::Fail(Named(
          {ErrorKind::kDevice, "active program: its crc, " + PlaceOf(map_.active.crc) + ", says " +
                                   Crc(block->crc) + ", its rows give " + Crc(crc) +
                                   ": half-written, changed while it was read, or a PLC that "
                                   "computes another crc (drivers/README.md)"}));
    }
    block->crc = crc;
    return block;
  }

  hal::Result<hal::ProgramBlock> ReadActiveAsItStands() override {
    return ReadProgram(map_.active, 0);
  }

  hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
    if (auto ok = CheckRegisterMap(map_); !ok) return hal::Fail(ok.error());
    if (auto ok = EncodeProgram(map_, map_.staging, block, image_); !ok) {
      return hal::Fail(Named(ok.error()));
    }
    return DecodeProgram(map_, map_.staging, image_);
  }

  hal::Result<void> Stage(const hal::ProgramBlock& block) override {
    if (auto ok = CheckRegisterMap(map_); !ok) return hal::Fail(ok.error());
    if (auto ok = EncodeProgram(map_, map_.staging, block, image_); !ok) {
      return hal::Fail(Named(ok.error()));
    }
    std::vector<RegisterRange> ranges = HeadRanges(map_.staging);
    ranges.push_back(RowsRange(map_, map_.staging, block.program.rows.size()));
    if (map_.commit) return carrier_->Write(ranges, image_);
    // Without a commit register the row count is what makes a program: 0 while the rest changes.
    enabled_rows_ = static_cast<std::uint32_t>(block.program.rows.size());
    enabled_sequence_ = block.sequence;
    if (auto ok = PutField(map_, map_.staging.row_count, 0, "row_count", image_); !ok) {
      return hal::Fail(Named(ok.error()));
    }
    if (auto ok = carrier_->Write({RangeOf(map_.staging.row_count)}, image_); !ok) return ok;
    // Rows that change under a count that it did not take could be bent.
    if (auto ok = carrier_->Read({RangeOf(map_.staging.row_count)}, image_); !ok) return ok;
    const auto taken = GetInteger(map_, map_.staging.row_count, "row_count", image_);
    if (!taken || *taken != 0) {
      return hal::Fail(Named({ErrorKind::kDevice, PlaceOf(map_.staging.row_count) +
                                                      ": row count 0 was written and not kept"}));
    }
    return carrier_->Write(ranges, image_);
  }

  hal::Result<hal::ProgramBlock> ReadStaged() override {
    return ReadProgram(map_.staging, map_.commit ? 0 : enabled_rows_);
  }

  hal::Result<void> Commit(std::uint32_t sequence) override {
    if (!map_.commit && (enabled_rows_ == 0 || enabled_sequence_ != sequence)) {
      return hal::Fail(
          Named({ErrorKind::kInternal, "commit of sequence " + std::to_string(sequence) +
                                           ", which is not the staged one"}));
    }
    const hal::RegisterField& field = map_.commit ? *map_.commit : map_.staging.row_count;
    const std::uint32_t value = map_.commit ? sequence : enabled_rows_;
    if (auto ok = PutField(map_, field, value, "commit", image_); !ok) {
      return hal::Fail(Named(ok.error()));
    }
    return carrier_->Write({RangeOf(field)}, image_);
  }

  hal::Result<void> Report(const hal::CellReport& report) override {
    if (auto ok = CheckRegisterMap(map_); !ok) return ok;
    if (auto ok = EncodeReport(map_, report, image_); !ok) return hal::Fail(Named(ok.error()));
    const std::vector<RegisterRange> ranges = ReportRanges(map_.report);
    const std::vector<RegisterRange> last = ReportSequenceRanges(map_.report);
    const std::vector<std::uint16_t> words = WordsOf(ranges, last);
    const bool is_known = words.size() == reported_.size();
    // Unless all goes well the PLC may hold anything.
    const std::vector<std::uint16_t> before = std::exchange(reported_, {});
    std::vector<RegisterRange> changed;
    std::size_t at = 0;
    const auto differs = [&](const RegisterRange& range) {
      const std::size_t from = std::exchange(at, at + range.count);
      return !is_known || !std::equal(words.begin() + static_cast<std::ptrdiff_t>(from),
                                      words.begin() + static_cast<std::ptrdiff_t>(at),
                                      before.begin() + static_cast<std::ptrdiff_t>(from));
    };
    std::copy_if(ranges.begin(), ranges.end(), std::back_inserter(changed), differs);
    if (!changed.empty()) {
      if (auto ok = carrier_->Write(changed, image_); !ok) return ok;
    }
    changed.clear();
    std::copy_if(last.begin(), last.end(), std::back_inserter(changed), differs);
    if (!changed.empty()) {
      if (auto ok = carrier_->Write(changed, image_); !ok) return ok;
    }
    reported_ = words;
    return {};
  }

 private:
  static const hal::RegisterField* Optional(const std::optional<hal::RegisterField>& field) {
    return field ? &*field : nullptr;
  }

  hal::Error Named(hal::Error error) const {
    error.message = "bender " + carrier_->peer() + ": " + error.message;
    return error;
  }

  std::vector<RegisterRange> StateRanges() const {
    std::vector<RegisterRange> ranges{RangeOf(map_.mode), RangeOf(map_.reply_sequence),
                                      RangeOf(map_.reply), RangeOf(map_.active.part_number),
                                      RangeOf(map_.active.sequence)};
    for (const auto* field :
         {&map_.fault_code, &map_.heartbeat, &map_.parts_bent, &map_.reply_code}) {
      if (*field) ranges.push_back(RangeOf(**field));
    }
    for (const RegisterRange& range : OrderRanges(map_.orders)) ranges.push_back(range);
    return ranges;
  }

  hal::Result<void> Read(const std::vector<RegisterRange>& ranges) {
    if (auto ok = CheckRegisterMap(map_); !ok) return ok;
    auto read = carrier_->Read(ranges, image_);
    if (!read) reported_.clear();  // it may come back having forgotten
    return read;
  }

  std::vector<std::uint16_t> WordsOf(const std::vector<RegisterRange>& ranges,
                                     const std::vector<RegisterRange>& more) const {
    std::vector<std::uint16_t> words;
    for (const auto* list : {&ranges, &more}) {
      for (const RegisterRange& range : *list) {
        const auto* from = image_.At(range.space, static_cast<std::uint16_t>(range.address));
        words.insert(words.end(), from, from + range.count);
      }
    }
    return words;
  }

  // `hidden_rows`: rows to read where the count register says 0.
  hal::Result<hal::ProgramBlock> ReadProgram(const hal::ProgramArea& area,
                                             std::uint32_t hidden_rows) {
    if (auto ok = Read(HeadRanges(area)); !ok) return hal::Fail(ok.error());
    const auto count = GetInteger(map_, area.row_count, "row_count", image_);
    if (!count) return hal::Fail(Named(count.error()));
    if (*count <= map_.max_rows) {  // DecodeProgram refuses any other
      const std::uint32_t rows = *count == 0 ? hidden_rows : *count;
      if (rows != *count) {
        if (auto ok = PutField(map_, area.row_count, rows, "row_count", image_); !ok) {
          return hal::Fail(Named(ok.error()));
        }
      }
      if (auto ok = Read({RowsRange(map_, area, rows)}); !ok) return hal::Fail(ok.error());
    }
    auto block = DecodeProgram(map_, area, image_);
    if (!block) return hal::Fail(Named(block.error()));
    return block;
  }

  std::uint32_t CrcOf(const hal::ProgramArea& area, const hal::ProgramBlock& block) const {
    return ProgramCrc(map_, area, block.part_number, block.sequence,
                      static_cast<std::uint32_t>(block.program.rows.size()), image_);
  }

  hal::RegisterMap map_;
  std::unique_ptr<RegisterCarrier> carrier_;
  RegisterImage image_;
  std::uint32_t enabled_rows_ = 0;  // of the last Stage, without a commit register
  std::uint32_t enabled_sequence_ = 0;
  std::vector<std::uint16_t> reported_;  // what the PLC holds of the last Report; empty: not known
};

}  // namespace

std::unique_ptr<hal::BenderLink> MakeRegisterBender(hal::RegisterMap map,
                                                    std::unique_ptr<RegisterCarrier> carrier) {
  return std::make_unique<RegisterBender>(std::move(map), std::move(carrier));
}

}  // namespace bendloop::drivers
