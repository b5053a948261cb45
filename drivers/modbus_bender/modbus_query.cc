// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_query.h"

#include <algorithm>
#include <cstdio>
#include <string>
#include <utility>

#include "drivers/modbus_bender/modbus_carrier.h"

namespace bendloop::drivers {
namespace {

using Bytes = std::span<const std::uint8_t>;

// The header: transaction 2, protocol 2, length 2 (of what follows it), unit 1.
constexpr std::size_t kProtocolAt = 2;
constexpr std::size_t kLengthAt = 4;
constexpr std::size_t kUnitAt = 6;
constexpr std::size_t kHeaderSize = 7;
constexpr std::uint8_t kExceptionBit = 0x80;

std::string Hex(Bytes data) {
  constexpr std::size_t kShown = 16;
  std::string text;
  for (const std::uint8_t value : data.first(std::min(data.size(), kShown))) {
    char byte[4];
    std::snprintf(byte, sizeof byte, "%02x ", value);
    text += byte;
  }
  if (data.size() > kShown) text += "... ";
  return text + "(" + std::to_string(data.size()) + " bytes)";
}

void Append16(std::vector<std::uint8_t>& bytes, std::uint32_t value) {
  bytes.push_back(static_cast<std::uint8_t>(value >> 8));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

std::uint16_t Load16(const std::uint8_t* data) {
  return static_cast<std::uint16_t>(data[0] << 8 | data[1]);
}

auto Wrong(std::string message) { return hal::Fail(hal::ErrorKind::kDevice, std::move(message)); }

}  // namespace

std::uint8_t ReadFunction(const RegisterRange& range) {
  return range.space == hal::RegisterSpace::kHolding ? 0x03 : 0x04;
}

std::uint8_t WriteFunction(const RegisterRange& range) { return range.count == 1 ? 0x06 : 0x10; }

ModbusQuery::ModbusQuery(std::uint16_t transaction, std::uint8_t unit, const RegisterRange& read)
    : count_(read.count) {
  Begin(transaction, unit, ReadFunction(read), read);
  Append16(frame_, count_);
  End();
}

ModbusQuery::ModbusQuery(std::uint16_t transaction, std::uint8_t unit, const RegisterRange& write,
                         const std::uint16_t* from)
    : count_(write.count) {
  Begin(transaction, unit, WriteFunction(write), write);
  if (count_ > 1) {
    Append16(frame_, count_);
    frame_.push_back(static_cast<std::uint8_t>(2 * count_));
  }
  for (std::uint32_t i = 0; i < count_; ++i) Append16(frame_, from[i]);
  End();
}

void ModbusQuery::Begin(std::uint16_t transaction, std::uint8_t unit, std::uint8_t function,
                        const RegisterRange& range) {
  Append16(frame_, transaction);
  Append16(frame_, 0);  // protocol
  Append16(frame_, 0);  // length
  frame_.push_back(unit);
  frame_.push_back(function);
  Append16(frame_, range.address);
}

void ModbusQuery::End() {
  const std::size_t length = frame_.size() - kUnitAt;
  frame_[kLengthAt] = static_cast<std::uint8_t>(length >> 8);
  frame_[kLengthAt + 1] = static_cast<std::uint8_t>(length);
}

std::uint16_t ModbusQuery::transaction() const { return Load16(frame_.data()); }

Bytes ModbusQuery::Request() const { return Bytes(frame_).subspan(kHeaderSize); }

bool ModbusQuery::IsAnsweredBy(Bytes answer) const {
  return answer.size() >= 2 && Load16(answer.data()) == transaction();
}

hal::Result<Bytes> ModbusQuery::Open(Bytes answer) const {
  const std::string came = "; the answer was " + Hex(answer);
  if (answer.size() < kHeaderSize + 2) return Wrong("answer too short" + came);
  if (!IsAnsweredBy(answer)) {
    return Wrong("answer to transaction " + std::to_string(Load16(answer.data())) + ", expected " +
                 std::to_string(transaction()) + came);
  }
  if (Load16(answer.data() + kProtocolAt) != 0 ||
      Load16(answer.data() + kLengthAt) != answer.size() - kUnitAt) {
    return Wrong("garbled Modbus header" + came);
  }
  if (answer[kUnitAt] != frame_[kUnitAt]) {
    return Wrong("answer from unit " + std::to_string(answer[kUnitAt]) + ", expected unit " +
                 std::to_string(frame_[kUnitAt]) + came);
  }
  const Bytes data = answer.subspan(kHeaderSize);
  const std::uint8_t asked = Request()[0];
  if (data[0] == (asked | kExceptionBit)) {
    return Wrong("the bender answers exception " + ModbusException(data[1]));
  }
  if (data[0] != asked) {
    return Wrong("answer to function " + std::to_string(data[0]) + ", expected " +
                 std::to_string(asked) + came);
  }
  return data;
}

hal::Result<void> ModbusQuery::TakeRead(Bytes answer, std::uint16_t* to) const {
  const auto data = Open(answer);
  if (!data) return hal::Fail(data.error());
  constexpr std::size_t kDataAt = 2;  // function, number of bytes
  if (data->size() != kDataAt + 2 * count_ || (*data)[1] != 2 * count_) {
    return Wrong("answer of " + std::to_string(data->size() - kDataAt) + " data bytes, expected " +
                 std::to_string(2 * count_));
  }
  for (std::uint32_t i = 0; i < count_; ++i) to[i] = Load16(data->data() + kDataAt + 2 * i);
  return {};
}

hal::Result<void> ModbusQuery::CheckEcho(Bytes answer) const {
  const auto data = Open(answer);
  if (!data) return hal::Fail(data.error());
  // Both functions echo the first five bytes of the request.
  const Bytes echo = Request().first(5);
  if (!std::equal(data->begin(), data->end(), echo.begin(), echo.end())) {
    return Wrong("the echo is " + Hex(*data) + ", expected " + Hex(echo));
  }
  return {};
}

}  // namespace bendloop::drivers
