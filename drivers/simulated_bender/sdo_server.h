// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/canopen_bender/sdo_wire.h"

namespace bendloop::drivers {

// The objects behind an SDO server. Both return an abort code; 0: done.
class SdoObjects {
 public:
  // The server stays silent instead of answering.
  static constexpr std::uint32_t kNoAnswer = 0xffffffff;

  virtual ~SdoObjects() = default;
  virtual std::uint32_t Read(ObjectId object, std::vector<std::uint8_t>& bytes) = 0;
  virtual std::uint32_t Write(ObjectId object, std::span<const std::uint8_t> bytes) = 0;
};

// The other end of SdoClient, written apart from it: a node's SDO server, frames in and frames out.
// Whatever comes, it takes no more than kMaxBytes and answers each request with a bounded number of
// frames.
class SdoServer {
 public:
  static constexpr std::size_t kMaxBytes = 1 << 16;

  struct Options {
    bool block = true;  // false: block transfer is declined
    std::uint8_t block_size = kMaxBlockSegments;
  };

  SdoServer(SdoObjects& objects, Options options) : objects_(objects), options_(options) {}
  explicit SdoServer(SdoObjects& objects) : SdoServer(objects, Options{}) {}

  void Receive(const SdoData& request);
  // The next frame of the answer; false: no more.
  bool NextFrame(SdoData& frame);
  void Reset();  // as after power-up

 private:
  enum class Phase : std::uint8_t {
    kIdle,
    kDownload,
    kUpload,
    kBlockDownload,
    kBlockDownloadEnd,
    kBlockUploadStart,
    kBlockUpload,
    kBlockUploadEnd,
  };

  void Answer(const SdoData& frame) { answer_ = frame; }
  void Abort(std::uint32_t code);
  void BeginDownload(const SdoData& request);
  void DownloadSegment(const SdoData& request);
  void BeginUpload(const SdoData& request);
  void UploadSegment(const SdoData& request);
  void BlockDownload(const SdoData& request);
  void BlockSegment(const SdoData& request);
  void BlockUpload(const SdoData& request);
  void Finish(const SdoData& good);
  bool Keep(const std::uint8_t* bytes, std::size_t count);

  SdoObjects& objects_;
  const Options options_;
  Phase phase_ = Phase::kIdle;
  ObjectId object_;
  std::vector<std::uint8_t> data_;
  std::optional<std::size_t> announced_;
  std::size_t position_ = 0;
  bool toggle_ = false;
  std::uint8_t sequence_ = 0;
  std::uint8_t block_size_ = 0;
  bool sending_ = false;  // segments of a block
  std::optional<SdoData> answer_;
};

}  // namespace bendloop::drivers
