// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/plc.h"

#include <algorithm>
#include <utility>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::host {
namespace {

using drivers::RangeOf;
using drivers::RegisterRange;

// One carrier for the robot's registers and the daemon's link: many PLCs serve one client only.
class Borrowed final : public drivers::RegisterCarrier {
 public:
  explicit Borrowed(drivers::RegisterCarrier& lender) : lender_(lender) {}
  std::string carrier() const override { return lender_.carrier(); }
  std::string peer() const override { return lender_.peer(); }
  hal::Result<void> Connect() override { return lender_.Connect(); }
  hal::Result<void> Read(const std::vector<RegisterRange>& ranges,
                         drivers::RegisterImage& image) override {
    return lender_.Read(ranges, image);
  }
  hal::Result<void> Write(const std::vector<RegisterRange>& ranges,
                          const drivers::RegisterImage& image) override {
    return lender_.Write(ranges, image);
  }
  Signs signs() const override { return lender_.signs(); }

 private:
  drivers::RegisterCarrier& lender_;
};

}  // namespace

Plc::Plc(hal::RegisterMap map, std::unique_ptr<drivers::RegisterCarrier> carrier, hal::Clock& clock)
    : map_(std::move(map)),
      clock_(clock),
      frames_(std::make_unique<FrameLog>(map_, std::move(carrier), clock)),
      form_(map_),
      link_(drivers::MakeRegisterBender(map_, std::make_unique<Borrowed>(*frames_))) {}

std::string Plc::Name() const { return frames_->carrier() + " " + frames_->peer(); }

bool Plc::Connect() {
  if (trouble_) return false;
  const auto info = link_->Connect();
  if (!info) {
    trouble_ = Trouble{Rule::kMode, info.error().message};
    return false;
  }
  max_sequence_ = info->max_sequence;
  has_heartbeat_ = info->has_heartbeat;
  return true;
}

bool Plc::Take(Rule rule, hal::Result<void> done) {
  if (!done) trouble_ = Trouble{rule, done.error().message};
  return done.has_value();
}

bool Plc::Read(const std::vector<RegisterRange>& ranges, Rule rule, const char* kind) {
  if (trouble_) return false;
  const auto begin = clock_.Now();
  if (!Take(rule, frames_->Read(ranges, in_))) return false;
  timing_.Add(kind, clock_.Now() - begin);
  return true;
}

bool Plc::Write(const std::vector<RegisterRange>& ranges, Rule rule, const char* kind) {
  if (trouble_) return false;
  const auto begin = clock_.Now();
  if (!Take(rule, frames_->Write(ranges, out_))) return false;
  timing_.Add(kind, clock_.Now() - begin);
  return true;
}

std::optional<PlcState> Plc::State() {
  std::vector<RegisterRange> ranges{RangeOf(map_.mode), RangeOf(map_.reply_sequence),
                                    RangeOf(map_.reply)};
  for (const auto* field :
       {&map_.fault_code, &map_.heartbeat, &map_.parts_bent, &map_.reply_code}) {
    if (*field) ranges.push_back(RangeOf(**field));
  }
  PlcState state;
  state.asked_at = clock_.Now();
  if (!Read(ranges, Rule::kMode, "read state")) return std::nullopt;
  state.at = clock_.Now();
  const std::pair<const hal::RegisterField*, std::pair<std::uint32_t*, const char*>> fields[] = {
      {&map_.mode, {&state.mode, "mode"}},
      {map_.heartbeat ? &*map_.heartbeat : nullptr, {&state.heartbeat, "heartbeat"}},
      {&map_.reply_sequence, {&state.reply_sequence, "reply_sequence"}},
      {&map_.reply, {&state.reply, "reply"}},
      {map_.reply_code ? &*map_.reply_code : nullptr, {&state.reply_code, "reply_code"}}};
  for (const auto& [field, target] : fields) {
    if (field == nullptr) continue;
    const auto value = drivers::GetInteger(map_, *field, target.second, in_);
    if (!value) {
      trouble_ = Trouble{Rule::kMode, value.error().message};
      return std::nullopt;
    }
    *target.first = *value;
  }
  if (!map_.heartbeat) state.heartbeat = frames_->signs().heartbeat.value_or(0);
  SawHeartbeat(state);
  return state;
}

std::optional<RegisterProgram> Plc::ReadProgram(const hal::ProgramArea& area,
                                                std::optional<std::size_t> rows) {
  const bool active = &area == &map_.active;
  const Rule rule = active ? Rule::kPanel : Rule::kStores;
  if (!Read(drivers::HeadRanges(area), rule, active ? "read active head" : "read staged head")) {
    return std::nullopt;
  }
  if (!rows) {
    const auto head = form_.Take(area, 0, in_);
    if (!head || head->row_count > map_.max_rows) {
      trouble_ = Trouble{rule, head ? "row_count: " + drivers::PlaceOf(area.row_count) + " says " +
                                          std::to_string(head->row_count) + " rows, at most " +
                                          std::to_string(map_.max_rows) + " were expected"
                                    : head.error().message};
      return std::nullopt;
    }
    rows = head->row_count;
  }
  if (*rows > 0 && !Read({drivers::RowsRange(map_, area, *rows)}, rule,
                         active ? "read active rows" : "read staged rows")) {
    return std::nullopt;
  }
  auto program = form_.Take(area, *rows, in_);
  if (program) return std::move(*program);
  trouble_ = Trouble{rule, program.error().message};
  return std::nullopt;
}

bool Plc::Stage(const RegisterProgram& program) {
  if (trouble_ || !Take(Rule::kStores, form_.Put(program, map_.staging, out_))) return false;
  auto ranges = drivers::HeadRanges(map_.staging);
  ranges.push_back(drivers::RowsRange(map_, map_.staging, program.words.size() / map_.row_stride));
  return Write(ranges, Rule::kStores, "stage");
}

bool Plc::StageRows(const RegisterProgram& program, std::size_t first, std::size_t count) {
  if (trouble_ || !Take(Rule::kStores, form_.Put(program, map_.staging, out_))) return false;
  RegisterRange range = drivers::RowsRange(map_, map_.staging, count);
  range.address += static_cast<std::uint32_t>(first * map_.row_stride);
  return Write({range}, Rule::kStores, "stage rows");
}

bool Plc::StageHead(const RegisterProgram& program) {
  if (trouble_ || !Take(Rule::kStores, form_.Put(program, map_.staging, out_))) return false;
  return Write(drivers::HeadRanges(map_.staging), Rule::kStores, "stage head");
}

bool Plc::StageHeadOneByOne(const RegisterProgram& program) {
  if (trouble_ || !Take(Rule::kStores, form_.Put(program, map_.staging, out_))) return false;
  auto ranges = drivers::HeadRanges(map_.staging);
  std::reverse(ranges.begin(), ranges.end());
  return std::all_of(ranges.begin(), ranges.end(), [this](const RegisterRange& range) {
    return Write({range}, Rule::kStores, "stage one value");
  });
}

bool Plc::Commit(std::uint32_t sequence) {
  if (trouble_ ||
      !Take(Rule::kReply, drivers::PutField(map_, *map_.commit, sequence, "commit", out_))) {
    return false;
  }
  return Write({RangeOf(*map_.commit)}, Rule::kReply, "write commit");
}

bool Plc::Answers() { return frames_->Read({RangeOf(map_.mode)}, in_).has_value(); }

void Plc::WatchHeartbeat() {
  heartbeat_.reset();
  beats_ = 0;
  longest_standstill_ = std::chrono::nanoseconds{0};
}

// What is surely stood still: from the first look at a value to the last one. How long nobody
// looked counts for nothing.
void Plc::SawHeartbeat(const PlcState& state) {
  if (heartbeat_ == state.heartbeat) {
    longest_standstill_ = std::max(longest_standstill_, state.asked_at - beat_at_);
    return;
  }
  if (heartbeat_) ++beats_;
  heartbeat_ = state.heartbeat;
  beat_at_ = state.at;
}

}  // namespace bendloop::host
