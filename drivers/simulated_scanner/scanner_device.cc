// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/scanner_device.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <utility>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/scanner_wire/wire_bytes.h"
#include "hal/saturating.h"

namespace bendloop::drivers {
namespace {

using hal::ReadStatus;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

// Messages are made while fewer bytes than this wait for the host: back-pressure.
constexpr std::size_t kMostWaitingBytes = 256 * 1024;
constexpr int kMostItemsATurn = 256;
constexpr std::uint32_t kMostGarbage = 1 << 24;
constexpr std::size_t kMostFloodBytes = 64 << 20;

struct FaultName {
  ScannerFault::Kind kind;
  bool usb;  // takes a cable
  const char* name;
  const char* amount;
  const char* help;
};
using Kind = ScannerFault::Kind;
constexpr FaultName kFaults[] = {
    {Kind::kGap, false, "gap", " N", "leave out N profiles"},
    {Kind::kRepeat, false, "repeat", "", "send a profile twice"},
    {Kind::kGarbage, false, "garbage", " BYTES", "random bytes between messages"},
    {Kind::kCorrupt, false, "corrupt", "", "a wrong byte in a message"},
    {Kind::kBadPose, false, "bad-pose", "", "a whole message with a pose that is none"},
    {Kind::kStall, false, "stall", " MS", "no profiles for a while"},
    {Kind::kMute, false, "mute", " MS", "nothing at all for a while, not even replies"},
    {Kind::kFlood, false, "flood", " N", "the next profile N times at once"},
    {Kind::kFault, false, "fault", "", "a fault event"},
    {Kind::kCut, false, "cut", "", "half a message, then hang up (USB: the cable out and in)"},
    {Kind::kHalt, true, "halt", "", "the IN pipe stalls until the host clears it"},
    {Kind::kUnplug, true, "unplug", " MS", "the cable is out for a while"}};

}  // namespace

std::string ScannerFaultHelp(bool usb) {
  std::string help;
  for (const FaultName& fault : kFaults) {
    if (fault.usb && !usb) continue;
    std::string what = std::string("  ") + fault.name + fault.amount;
    what.resize(23, ' ');
    help += what + fault.help + "\n";
  }
  return help;
}

hal::Result<ScannerFault> ParseScannerFault(const std::string& words, bool usb) {
  std::istringstream in(words);
  std::string word;
  in >> word;
  std::string known;
  ScannerFault parsed;
  bool good = false;
  for (const FaultName& fault : kFaults) {
    if (fault.usb && !usb) continue;
    known += (known.empty() ? "" : ", ") + std::string(fault.name) + fault.amount;
    if (word != fault.name) continue;
    parsed.kind = fault.kind;
    good = true;
  }
  if (!(in >> std::ws).eof() && in.peek() != 'a') good = good && in >> parsed.amount;
  if (in >> word) good = good && word == "after" && in >> parsed.after;
  if (!good || !(in >> std::ws).eof()) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "misbehave: expected " + known + "; then perhaps after N");
  }
  parsed.amount = std::max(parsed.amount, 1U);
  return parsed;
}

ScannerDevice::ScannerDevice(WireIdentity identity, hal::Clock& clock)
    : identity_(std::move(identity)), clock_(clock) {
  identity_.max_points =
      std::clamp(identity_.max_points, std::uint32_t{1}, std::uint32_t{kWireMaxPoints});
}

void ScannerDevice::Trigger(std::unique_ptr<hal::ProfileSource> scan, ScanPace pace) {
  ActiveScan active;
  active.scan = std::move(scan);
  active.pace = pace;
  scans_.push_back(std::move(active));
}

void ScannerDevice::GoOn() {
  stalled_until_.reset();
  mute_until_.reset();
}

void ScannerDevice::HostCame() {
  HostWent();
  decoder_.Reset();
  encoder_ = {};
  out_.clear();
  sent_ = 0;
  carrier_fault_.reset();
}

void ScannerDevice::HostWent() {
  started_ = false;
  out_.clear();
  sent_ = 0;
  if (!scans_.empty() && scans_.front().begun) Abandon();
}

void ScannerDevice::Abandon() {
  scans_.pop_front();
  ++scans_abandoned_;
}

bool ScannerDevice::IsMute() const { return mute_until_ && *mute_until_ > clock_.Now(); }

void ScannerDevice::Receive(std::span<const std::uint8_t> bytes) {
  if (IsMute()) return;
  while (!bytes.empty()) {
    bytes = bytes.subspan(decoder_.Push(bytes));
    while (const auto message = decoder_.Next()) Answer(*message);
  }
}

void ScannerDevice::Answer(const WireMessage& request) {
  WireReply reply{request.type, 0, request.sequence, ""};
  switch (request.type) {
    case WireType::kIdentify:
      encoder_.Append(identity_, out_);
      return;
    case WireType::kSettings: {
      WireSettings settings;
      if (!DecodeSettings(request.payload, settings)) {
        reply.status = 1;
        reply.text = "malformed settings";
      }
      break;
    }
    case WireType::kStart:
      // A scan that another host has seen the begin of is no whole one for this host.
      if (!scans_.empty() && scans_.front().begun) Abandon();
      started_ = true;
      break;
    case WireType::kStop:
      started_ = false;
      break;
    default:
      return;  // not a host's to say
  }
  encoder_.Append(reply, out_);
}

void ScannerDevice::Sent(std::size_t bytes) {
  sent_ += std::min(bytes, out_.size() - sent_);
  if (sent_ < out_.size()) return;
  out_.clear();
  sent_ = 0;
}

std::optional<ScannerFault> ScannerDevice::TakeCarrierFault() {
  if (!out_.empty()) return std::nullopt;
  return std::exchange(carrier_fault_, std::nullopt);
}

std::int64_t ScannerDevice::ItemTime() const {
  return scans_.front().item == ReadStatus::kEvent ? event_.t_ns : profile_.t_ns;
}

nanoseconds ScannerDevice::UntilDue() const {
  if (!started_ || carrier_fault_ || scans_.empty()) return nanoseconds::max();
  const nanoseconds now = clock_.Now();
  if (mute_until_ && *mute_until_ > now) return *mute_until_ - now;
  if (stalled_until_ && *stalled_until_ > now) return *stalled_until_ - now;
  const ActiveScan& active = scans_.front();
  const bool is_timed = active.item == ReadStatus::kEvent || active.item == ReadStatus::kProfile;
  if (!active.begun || active.pace == ScanPace::kMax || !is_timed) return nanoseconds(0);
  // The times of a damaged recording may be any numbers.
  const std::int64_t since = hal::SaturatingDifference(ItemTime(), active.first_t_ns);
  const std::int64_t passed = (now - active.begun_at).count();
  return std::max(nanoseconds(hal::SaturatingDifference(since, passed)), nanoseconds(0));
}

void ScannerDevice::Fetch() {
  ActiveScan& active = scans_.front();
  auto read = active.scan->Read(profile_, event_, nanoseconds(0));
  if (!read) {
    event_.kind = hal::ScanEventKind::kFault;
    event_.set_detail(read.error().message);
    encoder_.Append(event_, out_);
    return Abandon();
  }
  active.item = *read;
  if (!active.begun && *read != ReadStatus::kEnd) {
    active.begun = true;
    active.begun_at = clock_.Now();
    active.first_t_ns = ItemTime();
  }
}

bool ScannerDevice::SendProfile() {
  if (profile_.points.size() > identity_.max_points) return false;
  const std::int64_t t_ns = profile_.t_ns;
  const auto since =
      static_cast<double>(hal::SaturatingDifference(t_ns, scans_.front().first_t_ns));
  profile_.t_ns = hal::SaturatingDifference(t_ns, -std::llround(since * drift_ppm_ * 1e-6));
  const bool sent = encoder_.Append(profile_, out_).has_value();
  profile_.t_ns = t_ns;
  return sent;
}

// The next profile's message so many times; it is sent once more afterwards.
void ScannerDevice::Flood(std::uint32_t messages) {
  const std::size_t begin = out_.size();
  if (!SendProfile()) return;
  const std::size_t size = out_.size() - begin;
  messages = std::min(messages, static_cast<std::uint32_t>(kMostFloodBytes / size));
  out_.resize(begin + size * messages);
  for (std::uint32_t i = 1; i < messages; ++i) {
    std::copy_n(out_.data() + begin, size, out_.data() + begin + i * size);
  }
}

// A table. NOLINTNEXTLINE(readability-function-size)
bool ScannerDevice::DoMisbehave() {
  const ScannerFault now = misbehaviours_.front();
  misbehaviours_.pop_front();
  ActiveScan& active = scans_.front();
  switch (now.kind) {
    case Kind::kGap:
      for (std::uint32_t i = 0; i < now.amount; ++i) {
        Fetch();
        // Not beyond the end.
        if (scans_.empty() || &scans_.front() != &active || active.item != ReadStatus::kProfile) {
          break;
        }
      }
      return true;
    case Kind::kStall:
      stalled_until_ = clock_.Now() + milliseconds(now.amount);
      return true;
    case Kind::kMute:
      mute_until_ = clock_.Now() + milliseconds(now.amount);
      return true;
    case Kind::kGarbage:
      for (std::uint32_t i = 0; i < std::min(now.amount, kMostGarbage); ++i) {
        out_.push_back(static_cast<std::uint8_t>(random_.Uniform(0, 256)));
      }
      return true;
    case Kind::kFlood:
      Flood(now.amount);
      return true;
    case Kind::kFault: {
      hal::ScanEvent event;
      event.kind = hal::ScanEventKind::kFault;
      event.t_ns = profile_.t_ns;
      event.set_detail("laser too hot");
      encoder_.Append(event, out_);
      return true;
    }
    case Kind::kHalt:
    case Kind::kUnplug:
      carrier_fault_ = now;
      return true;
    case Kind::kRepeat:  // it is sent once more
      (void)SendProfile();
      return true;
    case Kind::kCorrupt:
    case Kind::kBadPose:
    case Kind::kCut:
      break;
  }
  // These spoil the next profile's message.
  const std::size_t begin = out_.size();
  if (!SendProfile()) return true;
  if (now.kind == Kind::kCorrupt) {
    out_[begin + kWireHeaderBytes + 20] ^= 0x5A;
  } else if (now.kind == Kind::kBadPose) {
    std::uint8_t* const payload = out_.data() + begin + kWireHeaderBytes;
    const std::size_t size = out_.size() - begin - kWireHeaderBytes - kWireTrailerBytes;
    StoreFloat64Little(7.0, payload + 40);
    StoreLittle(Crc32c({payload, size}), payload + size);
  } else {
    out_.resize(begin + (out_.size() - begin) / 2);
    carrier_fault_ = now;
  }
  active.item = ReadStatus::kTimeout;
  return true;
}

void ScannerDevice::SendNext() {
  switch (scans_.front().item) {
    case ReadStatus::kTimeout:
      return Fetch();
    case ReadStatus::kEvent:
      encoder_.Append(event_, out_);
      break;
    case ReadStatus::kProfile:
      if (!misbehaviours_.empty()) {
        if (misbehaviours_.front().after == 0 && DoMisbehave()) return;
        if (!misbehaviours_.empty() && misbehaviours_.front().after > 0) {
          --misbehaviours_.front().after;
        }
      }
      (void)SendProfile();
      break;
    case ReadStatus::kEnd:
      scans_.pop_front();
      ++scans_finished_;
      return;
  }
  scans_.front().item = ReadStatus::kTimeout;
}

void ScannerDevice::Work() {
  for (int i = 0; i < kMostItemsATurn && UntilDue() == nanoseconds(0) &&
                  out_.size() - sent_ < kMostWaitingBytes;
       ++i) {
    SendNext();
  }
}

}  // namespace bendloop::drivers
