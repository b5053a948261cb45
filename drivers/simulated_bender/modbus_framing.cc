// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/modbus_framing.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace bendloop::drivers {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kTcpHeader = 7;  // transaction, protocol, length, unit
constexpr std::size_t kLengthAt = 4;   // counts what follows it
// Longer than Modbus allows, so that a write of too many registers is answered, too.
constexpr std::size_t kLongest = 270;
// So long nobody speaks between two frames. 3.5 characters at 9600 baud are 4 ms; a pseudo-terminal
// has no baud, and a process may be kept from sending for a while.
constexpr std::chrono::milliseconds kSilence{20};

// Appends at most `count` bytes as soon as there are any; false: none came in time.
bool ReadSome(int from, std::size_t count, Clock::time_point deadline, Bytes& bytes) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    pollfd polled{from, POLLIN, 0};
    const int ready = poll(&polled, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0)));
    if (ready < 0 && errno == EINTR) continue;
    if (ready <= 0) return false;
    const std::size_t before = bytes.size();
    bytes.resize(before + count);
    const ssize_t got = read(from, bytes.data() + before, count);
    bytes.resize(before + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    return got > 0;
  }
}

bool ReadUpTo(int from, std::size_t size, Clock::time_point deadline, Bytes& bytes) {
  while (bytes.size() < size) {
    if (!ReadSome(from, size - bytes.size(), deadline, bytes)) return false;
  }
  return true;
}

// The length of a serial request with unit and crc, as far as its bytes tell; 0: they do not.
std::size_t RtuLength(const Bytes& bytes) {
  constexpr std::size_t kUnitFunctionCrc = 4;
  if (bytes.size() < 2) return kUnitFunctionCrc;
  const auto counted = [&](std::size_t count_at) {
    return count_at + 1 + (bytes.size() > count_at ? bytes[count_at] : 0u) + 2;
  };
  switch (bytes[1]) {
    case 0x07:
    case 0x0b:
    case 0x0c:
    case 0x11:
      return kUnitFunctionCrc;
    case 0x0f:
    case 0x10:
      return counted(6);
    case 0x16:
      return kUnitFunctionCrc + 6;
    case 0x17:
      return counted(10);
    default:
      return bytes[1] <= 0x08 ? kUnitFunctionCrc + 4 : 0;
  }
}

bool CrcFits(const Bytes& bytes) {
  constexpr std::size_t kShortest = 4;
  if (bytes.size() < kShortest) return false;
  const std::size_t body = bytes.size() - 2;
  return RtuCrc(bytes.data(), body) == (bytes[body] | bytes[body + 1] << 8);
}

}  // namespace

std::uint16_t Load16(const Bytes& bytes, std::size_t at) {
  return static_cast<std::uint16_t>(bytes[at] << 8 | bytes[at + 1]);
}

std::uint16_t RtuCrc(const std::uint8_t* bytes, std::size_t count) {
  constexpr std::uint16_t kReversedPolynomial = 0xA001;
  std::uint16_t crc = 0xFFFF;
  for (std::size_t i = 0; i < count; ++i) {
    crc ^= bytes[i];
    for (int bit = 0; bit < 8; ++bit) {
      crc = static_cast<std::uint16_t>(crc >> 1 ^ (crc & 1 ? kReversedPolynomial : 0));
    }
  }
  return crc;
}

std::optional<Bytes> ReadTcpRequest(int socket, std::chrono::milliseconds timeout) {
  const auto deadline = Clock::now() + timeout;
  Bytes bytes;
  if (!ReadUpTo(socket, kTcpHeader, deadline, bytes)) return std::nullopt;
  const std::size_t size = kLengthAt + 2u + Load16(bytes, kLengthAt);
  if (Load16(bytes, 2) != 0 || size <= kTcpHeader || size > kLongest) {
    return std::nullopt;
  }
  if (!ReadUpTo(socket, size, deadline, bytes)) return std::nullopt;
  return bytes;
}

std::optional<Bytes> ReadCanRequest(int socket) {
  Bytes bytes(kLongest);
  const ssize_t size = recv(socket, bytes.data(), bytes.size(), MSG_DONTWAIT);
  if (size <= static_cast<ssize_t>(kTcpHeader)) return std::nullopt;
  bytes.resize(static_cast<std::size_t>(size));
  if (Load16(bytes, kLengthAt) != bytes.size() - kLengthAt - 2) return std::nullopt;
  return bytes;
}

std::optional<Bytes> ReadRtuRequest(int line, std::chrono::milliseconds timeout) {
  const auto deadline = Clock::now() + timeout;
  Bytes bytes;
  while (bytes.size() <= kLongest) {
    const std::size_t size = RtuLength(bytes);
    if (size != 0 && bytes.size() >= size) {
      if (CrcFits(bytes)) return bytes;
      break;
    }
    const bool more = size != 0 ? ReadSome(line, size - bytes.size(), deadline, bytes)
                                : ReadSome(line, 1, Clock::now() + kSilence, bytes);
    if (more) continue;
    if (size == 0 && CrcFits(bytes)) return bytes;
    break;
  }
  for (Bytes rest; ReadSome(line, kLongest, Clock::now() + kSilence, rest);) {
    if (Clock::now() > deadline) break;
    rest.clear();
  }
  return std::nullopt;
}

}  // namespace bendloop::drivers
