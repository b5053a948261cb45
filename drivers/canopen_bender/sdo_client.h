// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/canopen_bender/sdo_wire.h"

namespace bendloop::drivers {

// One SDO transfer at a time, as a client of CiA 301: expedited, segmented or block, frames in and
// frames out, without socket or clock. The owner sends what NextFrame gives, hands in what comes,
// and says when nothing came in time. Memory is bounded by what the owner asked for, whatever sizes
// the server claims, and so is the number of frames.
class SdoClient {
 public:
  enum class Mode : std::uint8_t {
    kPlain,     // expedited or segmented
    kBlock,     // block transfer; if the server declines, segmented
    kTolerant,  // as kPlain; answers to earlier requests are passed over
  };

  // Reads the object; more than `max_size` bytes end the transfer.
  void Upload(ObjectId object, std::size_t max_size, Mode mode);
  // Writes it; `data` must not be empty.
  void Download(ObjectId object, std::vector<std::uint8_t> data, Mode mode);

  // The next frame to send. False: nothing to send before something comes, or ever.
  bool NextFrame(SdoData& frame);
  // What came with the server's identifier. True if it brought the transfer further: the time to
  // wait for an answer begins anew.
  bool Receive(std::span<const std::uint8_t> frame);
  // Nothing came in time: asks once more where the protocol can, else gives up.
  void Timeout();
  // Gives up for a reason of the owner's; the server is told.
  void GiveUp(const std::string& why);

  // Over; a last frame may still have to be sent.
  bool finished() const { return phase_ == Phase::kDone || phase_ == Phase::kFailed; }
  bool failed() const { return phase_ == Phase::kFailed; }
  // What was read, once finished.
  const std::vector<std::uint8_t>& data() const { return data_; }
  const std::string& error() const { return error_; }  // one line, if failed
  // It failed by the server's own word: an abort about this object.
  bool refused() const { return refused_; }
  // The server declined a block transfer and served the object otherwise.
  bool block_declined() const { return block_declined_; }

 private:
  enum class Phase : std::uint8_t {
    kIdle,
    kUpload,
    kUploadSegment,
    kBlockUpload,
    kBlockUploadSegments,
    kBlockUploadEnd,
    kDownload,
    kDownloadSegment,
    kBlockDownload,
    kBlockDownloadSegments,
    kBlockDownloadAck,
    kBlockDownloadEnd,
    kDone,
    kFailed,
  };

  void Begin(ObjectId object, Mode mode);
  void AskUpload();
  void AskDownload();
  void Send(std::uint8_t command, std::uint32_t value = 0);
  bool Fail(std::uint32_t abort_code, const std::string& why);
  bool Unexpected(const SdoData& frame);
  bool ServerAborted(const SdoData& frame);
  // Is it an answer to this transfer's request?
  bool Matches(const SdoData& frame);
  bool Accepts(std::size_t size, const char* verb);
  bool Append(const SdoData& frame, std::size_t count);
  bool CheckWhole();

  bool TakeUpload(const SdoData& frame);
  bool TakeUploadSegment(const SdoData& frame);
  bool TakeBlockUpload(const SdoData& frame);
  bool TakeBlockSegment(const SdoData& frame);
  bool TakeBlockUploadEnd(const SdoData& frame);
  bool TakeDownload(const SdoData& frame);
  bool TakeDownloadSegment(const SdoData& frame);
  bool TakeBlockDownload(const SdoData& frame);
  bool TakeBlockAck(const SdoData& frame);
  void AcknowledgeBlock();
  void NextSegment();
  SdoData BlockSegment();

  ObjectId object_;
  Mode mode_ = Mode::kPlain;
  Phase phase_ = Phase::kIdle;
  std::vector<std::uint8_t> data_;
  std::size_t max_size_ = 0;
  std::optional<std::size_t> announced_;  // upload: the size that the server told
  std::size_t position_ = 0;              // download: bytes that the server has
  bool toggle_ = false;
  bool crc_ = false;             // the server can compute it
  std::uint8_t block_size_ = 0;  // segments in a block
  std::uint8_t sequence_ = 0;    // of the last good segment in the block
  int repeats_ = 0;              // blocks that had to be repeated
  bool refused_ = false;
  bool block_declined_ = false;
  std::optional<SdoData> pending_;
  std::optional<SdoData> last_;      // the last frame that was accepted
  std::optional<ObjectId> strayed_;  // an answer about another object came
  std::string error_;
};

}  // namespace bendloop::drivers
