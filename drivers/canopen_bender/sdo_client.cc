// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/sdo_client.h"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace bendloop::drivers {
namespace {

constexpr std::size_t kExpeditedBytes = 4;
constexpr std::uint8_t kSwitchBelow = 15;  // fewer bytes may come without blocks
constexpr int kMaxRepeats = 8;

std::uint8_t Specifier(const SdoData& frame) { return frame[0] >> 5; }

std::uint8_t Command(std::uint8_t specifier, int rest) {
  return static_cast<std::uint8_t>(specifier << 5 | rest);
}

std::string Hex(const SdoData& frame) {
  std::string text;
  for (const std::uint8_t byte : frame) {
    char hex[4];
    std::snprintf(hex, sizeof hex, "%02x ", byte);
    text += hex;
  }
  text.pop_back();
  return text;
}

}  // namespace

void SdoClient::Begin(ObjectId object, Mode mode) {
  object_ = object;
  mode_ = mode;
  announced_.reset();
  position_ = 0;
  toggle_ = false;
  repeats_ = 0;
  refused_ = false;
  block_declined_ = false;
  pending_.reset();
  last_.reset();
  strayed_.reset();
  error_.clear();
}

void SdoClient::Upload(ObjectId object, std::size_t max_size, Mode mode) {
  Begin(object, mode);
  data_.clear();
  data_.reserve(max_size + kSegmentBytes);
  max_size_ = max_size;
  if (mode != Mode::kBlock) return AskUpload();
  phase_ = Phase::kBlockUpload;
  block_size_ = kMaxBlockSegments;
  Send(Command(kCcsBlockUpload, 0x04), block_size_ | kSwitchBelow << 8);
}

void SdoClient::Download(ObjectId object, std::vector<std::uint8_t> data, Mode mode) {
  Begin(object, mode);
  data_ = std::move(data);
  if (mode != Mode::kBlock || data_.size() <= kExpeditedBytes) return AskDownload();
  phase_ = Phase::kBlockDownload;
  Send(Command(kCcsBlockDownload, 0x06), static_cast<std::uint32_t>(data_.size()));
}

void SdoClient::AskUpload() {
  phase_ = Phase::kUpload;
  Send(Command(kCcsUpload, 0));
}

void SdoClient::AskDownload() {
  phase_ = Phase::kDownload;
  if (data_.size() > kExpeditedBytes) {
    Send(Command(kCcsDownload, 0x01), static_cast<std::uint32_t>(data_.size()));
    return;
  }
  std::uint32_t value = 0;
  for (std::size_t i = data_.size(); i > 0; --i) value = value << 8 | data_[i - 1];
  const auto unused = static_cast<int>(kExpeditedBytes - data_.size());
  Send(Command(kCcsDownload, unused << 2 | 0x03), value);
}

void SdoClient::Send(std::uint8_t command, std::uint32_t value) {
  pending_ = SdoFrame(command, object_, value);
}

bool SdoClient::NextFrame(SdoData& frame) {
  if (pending_) {
    frame = *pending_;
    pending_.reset();
    return true;
  }
  if (phase_ != Phase::kBlockDownloadSegments) return false;
  frame = BlockSegment();
  return true;
}

bool SdoClient::Fail(std::uint32_t abort_code, const std::string& why) {
  phase_ = Phase::kFailed;
  error_ = why;
  pending_.reset();
  if (abort_code != 0) Send(Command(kCsAbort, 0), abort_code);
  return false;
}

void SdoClient::GiveUp(const std::string& why) {
  if (!finished()) Fail(kAbortGeneral, why);
}

void SdoClient::Timeout() {
  if (finished()) return;
  if (phase_ == Phase::kBlockUploadSegments && ++repeats_ <= kMaxRepeats) {
    return AcknowledgeBlock();  // the end of the block was lost: from here once more
  }
  Fail(kAbortTimeout, strayed_ ? "no answer; one about " + hal::Name(*strayed_) + " came instead"
                               : std::string("no answer"));
}

bool SdoClient::Unexpected(const SdoData& frame) {
  if (mode_ == Mode::kTolerant) return false;
  return Fail(kAbortCommand, "the answer " + Hex(frame) + " does not fit the question");
}

bool SdoClient::ServerAborted(const SdoData& frame) {
  if (SdoObject(frame) != object_) return false;  // of an earlier transfer
  if (phase_ == Phase::kBlockUpload || phase_ == Phase::kBlockDownload) {
    const bool upload = phase_ == Phase::kBlockUpload;
    block_declined_ = true;
    upload ? AskUpload() : AskDownload();
    return true;
  }
  refused_ = true;
  Fail(0, "the bender aborts: " + AbortText(SdoValue(frame)));
  return true;
}

bool SdoClient::Matches(const SdoData& frame) {
  if (SdoObject(frame) == object_) return true;
  strayed_ = SdoObject(frame);
  return false;
}

bool SdoClient::Receive(std::span<const std::uint8_t> bytes) {
  if (phase_ == Phase::kIdle || finished()) return false;
  SdoData frame{};
  if (bytes.size() != frame.size()) {
    return Fail(kAbortGeneral,
                "an answer of " + std::to_string(bytes.size()) + " bytes, where SDO frames have 8");
  }
  std::copy(bytes.begin(), bytes.end(), frame.begin());
  if (frame[0] == Command(kCsAbort, 0)) return ServerAborted(frame);
  // CAN may deliver a frame twice. Within blocks sequence numbers tell.
  if (last_ == frame && phase_ != Phase::kBlockDownloadAck &&
      phase_ != Phase::kBlockUploadSegments) {
    return false;
  }
  bool further = false;
  switch (phase_) {
    case Phase::kUpload:
      further = TakeUpload(frame);
      break;
    case Phase::kUploadSegment:
      further = TakeUploadSegment(frame);
      break;
    case Phase::kBlockUpload:
      further = Specifier(frame) == kScsUpload ? TakeUpload(frame) : TakeBlockUpload(frame);
      break;
    case Phase::kBlockUploadSegments:
      further = TakeBlockSegment(frame);
      break;
    case Phase::kBlockUploadEnd:
      further = TakeBlockUploadEnd(frame);
      break;
    case Phase::kDownload:
      further = TakeDownload(frame);
      break;
    case Phase::kDownloadSegment:
      further = TakeDownloadSegment(frame);
      break;
    case Phase::kBlockDownload:
      further = TakeBlockDownload(frame);
      break;
    case Phase::kBlockDownloadAck:
      further = TakeBlockAck(frame);
      break;
    case Phase::kBlockDownloadEnd:
      if ((frame[0] & 0xe3) != Command(kScsBlockDownload, 1)) return Unexpected(frame);
      phase_ = Phase::kDone;
      further = true;
      break;
    default:  // while a block is sent only an abort is news
      return false;
  }
  if (further) last_ = frame;
  return further;
}

bool SdoClient::Accepts(std::size_t size, const char* verb) {
  if (size <= max_size_) return true;
  return Fail(kAbortMemory, std::string("the bender ") + verb + " " + std::to_string(size) +
                                " bytes, at most " + std::to_string(max_size_) + " were expected");
}

bool SdoClient::Append(const SdoData& frame, std::size_t count) {
  // Of a block's last segment it is only told later how much of it counts.
  const std::size_t room = phase_ == Phase::kBlockUploadSegments ? kSegmentBytes - 1 : 0;
  if (data_.size() + count > max_size_ + room) {
    return Fail(kAbortMemory, "more than " + std::to_string(max_size_) + " bytes came");
  }
  data_.insert(data_.end(), frame.begin() + 1, frame.begin() + 1 + static_cast<long>(count));
  return true;
}

bool SdoClient::CheckWhole() {
  if (!announced_ || *announced_ == data_.size()) return true;
  return Fail(kAbortLength, "the bender announced " + std::to_string(*announced_) +
                                " bytes and sent " + std::to_string(data_.size()));
}

bool SdoClient::TakeUpload(const SdoData& frame) {
  if (Specifier(frame) != kScsUpload) return Unexpected(frame);
  if (!Matches(frame)) return false;
  const bool expedited = frame[0] & 0x02;
  const bool sized = frame[0] & 0x01;
  if (expedited) {
    const std::size_t size =
        sized ? kExpeditedBytes - (frame[0] >> 2 & 3) : std::min(kExpeditedBytes, max_size_);
    if (!Accepts(size, "sends")) return false;
    data_.assign(frame.begin() + 4, frame.begin() + 4 + static_cast<long>(size));
    phase_ = Phase::kDone;
    return true;
  }
  if (sized) announced_ = SdoValue(frame);
  if (!Accepts(announced_.value_or(0), "announces")) return false;
  phase_ = Phase::kUploadSegment;
  pending_ = SdoData{Command(kCcsUploadSegment, 0)};
  return true;
}

bool SdoClient::TakeUploadSegment(const SdoData& frame) {
  if (Specifier(frame) != kScsUploadSegment) return Unexpected(frame);
  if (((frame[0] >> 4 & 1) != 0) != toggle_) return Fail(kAbortToggle, "toggle bit not alternated");
  const std::size_t count = kSegmentBytes - (frame[0] >> 1 & 7);
  const bool last = frame[0] & 1;
  if (count == 0 && !last) return Fail(kAbortLength, "an empty segment that is not the last");
  if (!Append(frame, count)) return false;
  if (last) {
    if (CheckWhole()) phase_ = Phase::kDone;
    return true;
  }
  toggle_ = !toggle_;
  pending_ = SdoData{Command(kCcsUploadSegment, toggle_ << 4)};
  return true;
}

bool SdoClient::TakeBlockUpload(const SdoData& frame) {
  if (Specifier(frame) != kScsBlockUpload || (frame[0] & 1) != 0) return Unexpected(frame);
  if (!Matches(frame)) return false;
  crc_ = frame[0] & 0x04;
  if (frame[0] & 0x02) announced_ = SdoValue(frame);
  if (!Accepts(announced_.value_or(0), "announces")) return false;
  phase_ = Phase::kBlockUploadSegments;
  sequence_ = 0;
  pending_ = SdoData{Command(kCcsBlockUpload, 3)};
  return true;
}

bool SdoClient::TakeBlockSegment(const SdoData& frame) {
  const std::uint8_t sequence = frame[0] & 0x7f;
  const bool last = frame[0] & 0x80;
  const bool in_order = sequence == sequence_ + 1 && sequence <= block_size_;
  if (in_order) {
    if (!Append(frame, kSegmentBytes)) return false;
    sequence_ = sequence;
  } else if (sequence <= sequence_ || sequence > block_size_) {
    return false;  // once more
  }
  if (!last && sequence != block_size_) return in_order;
  if (in_order && last) {
    AcknowledgeBlock();
    phase_ = Phase::kBlockUploadEnd;
    return true;
  }
  if (!in_order && ++repeats_ > kMaxRepeats) {
    return Fail(kAbortSequence, "segments are lost again and again");
  }
  AcknowledgeBlock();
  return true;
}

void SdoClient::AcknowledgeBlock() {
  pending_ = SdoData{Command(kCcsBlockUpload, 2), sequence_, block_size_};
  sequence_ = 0;
}

bool SdoClient::TakeBlockUploadEnd(const SdoData& frame) {
  if ((frame[0] & 0xe3) != Command(kScsBlockUpload, 1)) return Unexpected(frame);
  const std::size_t unused = std::min<std::size_t>(frame[0] >> 2 & 7, data_.size());
  data_.erase(data_.end() - static_cast<long>(unused), data_.end());
  if (!Accepts(data_.size(), "sent") || !CheckWhole()) return true;
  const auto crc = static_cast<std::uint16_t>(frame[1] | frame[2] << 8);
  if (crc_ && crc != SdoCrc(data_)) {
    Fail(kAbortCrc, "the crc of the block transfer is wrong");
    return true;
  }
  phase_ = Phase::kDone;
  pending_ = SdoData{Command(kCcsBlockUpload, 1)};
  return true;
}

bool SdoClient::TakeDownload(const SdoData& frame) {
  if (Specifier(frame) != kScsDownload) return Unexpected(frame);
  if (!Matches(frame)) return false;
  if (data_.size() <= kExpeditedBytes) {
    phase_ = Phase::kDone;
    return true;
  }
  phase_ = Phase::kDownloadSegment;
  NextSegment();
  return true;
}

void SdoClient::NextSegment() {
  const std::size_t count = std::min<std::size_t>(kSegmentBytes, data_.size() - position_);
  const int last = position_ + count == data_.size() ? 1 : 0;
  const auto unused = static_cast<int>(kSegmentBytes - count);
  SdoData frame{Command(kCcsDownloadSegment, toggle_ << 4 | unused << 1 | last)};
  std::copy_n(data_.begin() + static_cast<long>(position_), count, frame.begin() + 1);
  pending_ = frame;
}

bool SdoClient::TakeDownloadSegment(const SdoData& frame) {
  if (Specifier(frame) != kScsDownloadSegment) return Unexpected(frame);
  if (((frame[0] >> 4 & 1) != 0) != toggle_) return Fail(kAbortToggle, "toggle bit not alternated");
  position_ += kSegmentBytes;
  toggle_ = !toggle_;
  if (position_ >= data_.size()) {
    phase_ = Phase::kDone;
  } else {
    NextSegment();
  }
  return true;
}

bool SdoClient::TakeBlockDownload(const SdoData& frame) {
  if ((frame[0] & 0xe3) != Command(kScsBlockDownload, 0)) return Unexpected(frame);
  if (!Matches(frame)) return false;
  crc_ = frame[0] & 0x04;
  block_size_ = frame[4];
  if (block_size_ < 1 || block_size_ > kMaxBlockSegments) {
    return Fail(kAbortBlockSize,
                "block size " + std::to_string(block_size_) + ", expected 1 to 127");
  }
  phase_ = Phase::kBlockDownloadSegments;
  sequence_ = 0;
  return true;
}

SdoData SdoClient::BlockSegment() {
  const std::size_t from = position_ + std::size_t{sequence_} * kSegmentBytes;
  const std::size_t count = std::min<std::size_t>(kSegmentBytes, data_.size() - from);
  const bool last = from + count == data_.size();
  ++sequence_;
  SdoData frame{static_cast<std::uint8_t>((last ? 0x80 : 0) | sequence_)};
  std::copy_n(data_.begin() + static_cast<long>(from), count, frame.begin() + 1);
  if (last || sequence_ == block_size_) phase_ = Phase::kBlockDownloadAck;
  return frame;
}

bool SdoClient::TakeBlockAck(const SdoData& frame) {
  if ((frame[0] & 0xe3) != Command(kScsBlockDownload, 2)) return Unexpected(frame);
  const std::uint8_t got = frame[1];
  const std::uint8_t next_size = frame[2];
  if (got > sequence_) {
    return Fail(kAbortSequence, "segment " + std::to_string(got) + " is acknowledged, but only " +
                                    std::to_string(sequence_) + " were sent");
  }
  if (next_size < 1 || next_size > kMaxBlockSegments) {
    return Fail(kAbortBlockSize, "block size " + std::to_string(next_size) + ", expected 1 to 127");
  }
  if (got < sequence_ && ++repeats_ > kMaxRepeats) {
    return Fail(kAbortSequence, "segments are lost again and again");
  }
  position_ += std::size_t{got} * kSegmentBytes;
  sequence_ = 0;
  block_size_ = next_size;
  if (position_ < data_.size()) {
    phase_ = Phase::kBlockDownloadSegments;
    return true;
  }
  const auto unused = static_cast<int>(position_ - data_.size());
  const std::uint16_t crc = crc_ ? SdoCrc(data_) : std::uint16_t{0};
  pending_ = SdoData{Command(kCcsBlockDownload, unused << 2 | 1), static_cast<std::uint8_t>(crc),
                     static_cast<std::uint8_t>(crc >> 8)};
  phase_ = Phase::kBlockDownloadEnd;
  return true;
}

}  // namespace bendloop::drivers
