// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/sdo_server.h"

#include <algorithm>

namespace bendloop::drivers {
namespace {

std::uint8_t Byte(unsigned value) { return static_cast<std::uint8_t>(value); }

}  // namespace

void SdoServer::Reset() {
  phase_ = Phase::kIdle;
  sending_ = false;
  answer_.reset();
}

void SdoServer::Abort(std::uint32_t code) {
  Reset();
  if (code != SdoObjects::kNoAnswer) Answer(SdoFrame(0x80, object_, code));
}

bool SdoServer::Keep(const std::uint8_t* bytes, std::size_t count) {
  if (data_.size() + count > kMaxBytes) {
    Abort(kAbortMemory);
    return false;
  }
  data_.insert(data_.end(), bytes, bytes + count);
  return true;
}

// All bytes are here: writes them.
void SdoServer::Finish(const SdoData& good) {
  if (announced_ && *announced_ != data_.size()) return Abort(kAbortLength);
  const std::uint32_t code = objects_.Write(object_, data_);
  if (code != 0) return Abort(code);
  Reset();
  Answer(good);
}

void SdoServer::Receive(const SdoData& request) {
  answer_.reset();
  const unsigned command = request[0] >> 5;
  // Segments of a block have no command; 0x80 would be segment number 0.
  if (phase_ == Phase::kBlockDownload && request[0] != 0x80) return BlockSegment(request);
  sending_ = false;
  switch (command) {
    case kCcsDownload:
      return BeginDownload(request);
    case kCcsUpload:
      return BeginUpload(request);
    case kCcsDownloadSegment:
      return DownloadSegment(request);
    case kCcsUploadSegment:
      return UploadSegment(request);
    case kCcsBlockDownload:
      return BlockDownload(request);
    case kCcsBlockUpload:
      return BlockUpload(request);
    case kCsAbort:
      return Reset();
    default:
      object_ = SdoObject(request);
      return Abort(kAbortCommand);
  }
}

void SdoServer::BeginDownload(const SdoData& request) {
  Reset();
  object_ = SdoObject(request);
  data_.clear();
  announced_.reset();
  toggle_ = false;
  const SdoData good = SdoFrame(0x60, object_, 0);
  if (request[0] & 0x02) {
    const std::size_t size = request[0] & 0x01 ? 4u - (request[0] >> 2 & 3u) : 4u;
    if (Keep(&request[4], size)) Finish(good);
    return;
  }
  if (request[0] & 0x01) announced_ = SdoValue(request);
  if (announced_.value_or(0) > kMaxBytes) return Abort(kAbortMemory);
  phase_ = Phase::kDownload;
  Answer(good);
}

void SdoServer::DownloadSegment(const SdoData& request) {
  if (phase_ != Phase::kDownload) return Abort(kAbortCommand);
  if (((request[0] & 0x10) != 0) != toggle_) return Abort(kAbortToggle);
  if (!Keep(&request[1], 7u - (request[0] >> 1 & 7u))) return;
  const SdoData good{Byte(0x20u | (toggle_ ? 0x10u : 0u))};
  toggle_ = !toggle_;
  if (request[0] & 0x01) return Finish(good);
  Answer(good);
}

void SdoServer::BeginUpload(const SdoData& request) {
  Reset();
  object_ = SdoObject(request);
  data_.clear();
  if (const std::uint32_t code = objects_.Read(object_, data_); code != 0) return Abort(code);
  if (!data_.empty() && data_.size() <= 4) {
    SdoData answer = SdoFrame(Byte(0x43u | (4u - data_.size()) << 2), object_, 0);
    std::copy(data_.begin(), data_.end(), answer.begin() + 4);
    return Answer(answer);
  }
  phase_ = Phase::kUpload;
  position_ = 0;
  toggle_ = false;
  Answer(SdoFrame(0x41, object_, static_cast<std::uint32_t>(data_.size())));
}

void SdoServer::UploadSegment(const SdoData& request) {
  if (phase_ != Phase::kUpload) return Abort(kAbortCommand);
  if (((request[0] & 0x10) != 0) != toggle_) return Abort(kAbortToggle);
  const std::size_t count = std::min<std::size_t>(7, data_.size() - position_);
  const bool last = position_ + count == data_.size();
  SdoData answer{
      Byte((toggle_ ? 0x10u : 0u) | static_cast<unsigned>(7 - count) << 1 | (last ? 1u : 0u))};
  std::copy_n(data_.begin() + static_cast<long>(position_), count, answer.begin() + 1);
  position_ += count;
  toggle_ = !toggle_;
  if (last) Reset();
  Answer(answer);
}

void SdoServer::BlockDownload(const SdoData& request) {
  if ((request[0] & 0x01) == 0) {
    Reset();
    object_ = SdoObject(request);
    if (!options_.block) return Abort(kAbortCommand);
    data_.clear();
    announced_.reset();
    if (request[0] & 0x02) announced_ = SdoValue(request);
    if (announced_.value_or(0) > kMaxBytes) return Abort(kAbortMemory);
    phase_ = Phase::kBlockDownload;
    sequence_ = 0;
    return Answer(SdoFrame(0xa4, object_, options_.block_size));
  }
  if (phase_ != Phase::kBlockDownloadEnd) return Abort(kAbortCommand);
  const std::size_t unused = std::min<std::size_t>(request[0] >> 2 & 7u, data_.size());
  data_.erase(data_.end() - static_cast<long>(unused), data_.end());
  if (SdoCrc(data_) != (request[1] | request[2] << 8)) return Abort(kAbortCrc);
  Finish(SdoData{0xa1});
}

void SdoServer::BlockSegment(const SdoData& request) {
  const unsigned sequence = request[0] & 0x7fu;
  const bool last = request[0] & 0x80u;
  const bool in_order = sequence == sequence_ + 1u;
  if (in_order) {
    if (!Keep(&request[1], 7)) return;
    sequence_ = Byte(sequence);
  }
  if (!last && sequence != options_.block_size) return;
  if (in_order && last) phase_ = Phase::kBlockDownloadEnd;
  Answer(SdoData{0xa2, sequence_, options_.block_size});
  sequence_ = 0;
}

void SdoServer::BlockUpload(const SdoData& request) {
  switch (request[0] & 0x03) {
    case 0: {
      Reset();
      object_ = SdoObject(request);
      if (!options_.block) return Abort(kAbortCommand);
      block_size_ = request[4];
      if (block_size_ < 1 || block_size_ > kMaxBlockSegments) return Abort(kAbortBlockSize);
      data_.clear();
      if (const std::uint32_t code = objects_.Read(object_, data_); code != 0) return Abort(code);
      if (data_.empty() || data_.size() < request[5]) return BeginUpload(request);
      phase_ = Phase::kBlockUploadStart;
      position_ = 0;
      return Answer(SdoFrame(0xc6, object_, static_cast<std::uint32_t>(data_.size())));
    }
    case 3:
      if (phase_ != Phase::kBlockUploadStart) return Abort(kAbortCommand);
      phase_ = Phase::kBlockUpload;
      sequence_ = 0;
      sending_ = true;
      return;
    case 2: {
      if (phase_ != Phase::kBlockUpload) return Abort(kAbortCommand);
      if (request[1] > sequence_) return Abort(kAbortSequence);
      if (request[2] < 1 || request[2] > kMaxBlockSegments) return Abort(kAbortBlockSize);
      block_size_ = request[2];
      position_ += std::size_t{request[1]} * 7;
      sequence_ = 0;
      sending_ = position_ < data_.size();
      if (sending_) return;
      phase_ = Phase::kBlockUploadEnd;
      const std::uint16_t crc = SdoCrc(data_);
      const auto unused = static_cast<unsigned>(position_ - data_.size());
      return Answer(SdoData{Byte(0xc1u | unused << 2), Byte(crc), Byte(crc >> 8u)});
    }
    default:
      if (phase_ != Phase::kBlockUploadEnd) return Abort(kAbortCommand);
      return Reset();
  }
}

bool SdoServer::NextFrame(SdoData& frame) {
  if (answer_) {
    frame = *answer_;
    answer_.reset();
    return true;
  }
  if (!sending_) return false;
  const std::size_t from = position_ + std::size_t{sequence_} * 7;
  const std::size_t count = std::min<std::size_t>(7, data_.size() - from);
  const bool last = from + count == data_.size();
  frame = SdoData{Byte((last ? 0x80u : 0u) | ++sequence_)};
  std::copy_n(data_.begin() + static_cast<long>(from), count, frame.begin() + 1);
  if (last || sequence_ == block_size_) sending_ = false;
  return true;
}

}  // namespace bendloop::drivers
