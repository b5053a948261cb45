// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/frame_log.h"

#include <cstdint>
#include <cstdio>
#include <optional>

#include "drivers/register_bender/program_codec.h"

namespace bendloop::host {
namespace {

using drivers::RegisterRange;

// More registers of one request are cut in the text: two rows show what is wrong as well as forty.
constexpr std::uint32_t kMostWords = 16;
// Ranges that touch are one request on Modbus; how many fit into one is the carrier's business.
constexpr std::uint16_t kAnyCount = 65535;

// What stands at a range's first register: "1000", "i30" for an input register, "2020sub1".
std::string PlaceName(const hal::RegisterMap& map, const RegisterRange& range) {
  if (!map.of_objects()) {
    const bool input = range.space == hal::RegisterSpace::kInput;
    return (input ? "i" : "") + std::to_string(range.address);
  }
  const auto of = [&](const hal::RegisterField& field) {
    return field.address == range.address ? hal::Name(field.object) : std::string();
  };
  const auto of_area = [&](const hal::ProgramArea& area) {
    if (area.rows_address == range.address) return hal::Name(area.rows_object);
    return of(area.part_number) + of(area.sequence) + of(area.row_count) + of(area.crc);
  };
  std::string name = of(map.mode) + of(map.reply_sequence) + of(map.reply);
  for (const auto* field :
       {&map.fault_code, &map.heartbeat, &map.parts_bent, &map.reply_code, &map.commit}) {
    if (*field) name += of(**field);
  }
  return name + of_area(map.active) + of_area(map.staging);
}

}  // namespace

hal::Result<void> FrameLog::Read(const std::vector<RegisterRange>& ranges,
                                 drivers::RegisterImage& image) {
  const auto at = clock_.Now();
  auto done = carrier_->Read(ranges, image);
  Note("read ", at, ranges, image, done);
  return done;
}

hal::Result<void> FrameLog::Write(const std::vector<RegisterRange>& ranges,
                                  const drivers::RegisterImage& image) {
  const auto at = clock_.Now();
  auto done = carrier_->Write(ranges, image);
  Note("write ", at, ranges, image, done);
  return done;
}

void FrameLog::Clear() {
  frames_.clear();
  left_out_ = 0;
}

std::vector<Frame> FrameLog::frames() const {
  std::vector<Frame> frames = frames_;
  if (left_out_ > 0) {
    frames.insert(frames.begin() + kFirst,
                  {frames[kFirst].at, "... " + std::to_string(left_out_) + " more"});
  }
  return frames;
}

void FrameLog::Note(const char* verb, std::chrono::nanoseconds at,
                    const std::vector<RegisterRange>& ranges, const drivers::RegisterImage& image,
                    const hal::Result<void>& done) {
  for (const RegisterRange& range :
       map_.of_objects() ? ranges : drivers::PlanRequests(ranges, kAnyCount)) {
    std::string text = verb + PlaceName(map_, range) + ":";
    const auto* word = image.At(range.space, static_cast<std::uint16_t>(range.address));
    for (std::uint32_t i = 0; i < range.count && i < kMostWords; ++i) {
      char hex[8];
      std::snprintf(hex, sizeof hex, " %04x", word[i]);
      text += hex;
    }
    if (range.count > kMostWords) text += " ... of " + std::to_string(range.count);
    if (!done) text = verb + PlaceName(map_, range) + ": " + done.error().message;
    if (frames_.size() == kFirst + kLast) {
      frames_.erase(frames_.begin() + kFirst);
      ++left_out_;
    }
    frames_.push_back({at, text});
    if (!done) return;
  }
}

}  // namespace bendloop::host
