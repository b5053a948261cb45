// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "hal/register_map.h"

namespace bendloop::drivers {

// What client and server of CiA 301's SDO protocol share.

using ObjectId = hal::ObjectAddress;

using SdoData = std::array<std::uint8_t, 8>;  // an SDO frame always has 8 bytes

// First byte: command specifiers of the client (request) and of the server (reply).
enum SdoCommand : std::uint8_t {
  kCcsDownloadSegment = 0,
  kCcsDownload = 1,
  kCcsUpload = 2,
  kCcsUploadSegment = 3,
  kCsAbort = 4,
  kCcsBlockUpload = 5,
  kCcsBlockDownload = 6,
  kScsUploadSegment = 0,
  kScsDownloadSegment = 1,
  kScsUpload = 2,
  kScsDownload = 3,
  kScsBlockDownload = 5,
  kScsBlockUpload = 6,
};

constexpr std::uint8_t kSegmentBytes = 7;
constexpr std::uint8_t kMaxBlockSegments = 127;

enum SdoAbort : std::uint32_t {
  kAbortToggle = 0x05030000,
  kAbortTimeout = 0x05040000,
  kAbortCommand = 0x05040001,
  kAbortBlockSize = 0x05040002,
  kAbortSequence = 0x05040003,
  kAbortCrc = 0x05040004,
  kAbortMemory = 0x05040005,
  kAbortAccess = 0x06010000,
  kAbortWriteOnly = 0x06010001,
  kAbortReadOnly = 0x06010002,
  kAbortNoObject = 0x06020000,
  kAbortLength = 0x06070010,
  kAbortTooLong = 0x06070012,
  kAbortTooShort = 0x06070013,
  kAbortNoSub = 0x06090011,
  kAbortGeneral = 0x08000000,
};

// "0x06020000, the object does not exist in the object dictionary".
std::string AbortText(std::uint32_t code);

// CRC-16 of block transfer: polynomial 0x1021, start 0, high bit first.
std::uint16_t SdoCrc(std::span<const std::uint8_t> data);

SdoData SdoFrame(std::uint8_t command, ObjectId object, std::uint32_t value);
std::uint32_t SdoValue(const SdoData& frame);  // bytes 4 to 7, low byte first
ObjectId SdoObject(const SdoData& frame);      // bytes 1 to 3

}  // namespace bendloop::drivers
