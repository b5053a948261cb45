// SPDX-License-Identifier: Apache-2.0
#include "drivers/modbus_bender/modbus_carrier.h"

#include <poll.h>

#include <array>

#include "drivers/modbus_bender/modbus_query.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::drivers {
namespace {

std::string RangeName(const RegisterRange& range) {
  const std::string first = std::to_string(range.address);
  if (range.count == 1) return "register " + first;
  return "registers " + first + " to " + std::to_string(range.address + range.count - 1);
}

std::string FunctionName(std::uint8_t function) {
  return " (function " + std::to_string(function) + ")";
}

}  // namespace

std::string ModbusException(int code) {
  constexpr std::array<const char*, 12> kNames{nullptr,
                                               "illegal function",
                                               "illegal data address",
                                               "illegal data value",
                                               "device failure",
                                               "acknowledge, still working",
                                               "device busy",
                                               nullptr,
                                               "memory parity error",
                                               nullptr,
                                               "gateway path unavailable",
                                               "gateway target does not respond"};
  const auto at = static_cast<std::size_t>(code);
  const bool known = at < kNames.size() && kNames[at] != nullptr;
  return std::to_string(code) + ", " + (known ? kNames[at] : "unknown exception");
}

hal::Result<void> ModbusCarrier::Read(const std::vector<RegisterRange>& ranges,
                                      RegisterImage& image) {
  for (const RegisterRange& range : PlanRequests(ranges, max_read_)) {
    std::uint16_t* to = image.At(range.space, static_cast<std::uint16_t>(range.address));
    const bool holding = range.space == hal::RegisterSpace::kHolding;
    const std::string what = std::string("read ") + (holding ? "holding " : "input ") +
                             RangeName(range) + FunctionName(ReadFunction(range));
    if (auto ok = Exchange(what, [&] { return ReadRange(range, to); }); !ok) return ok;
  }
  return {};
}

hal::Result<void> ModbusCarrier::Write(const std::vector<RegisterRange>& ranges,
                                       const RegisterImage& image) {
  for (const RegisterRange& range : PlanRequests(ranges, max_write_)) {
    const auto* from = image.At(range.space, static_cast<std::uint16_t>(range.address));
    const std::string what = "write " + RangeName(range) + FunctionName(WriteFunction(range));
    if (auto ok = Exchange(what, [&] { return WriteRange(range, from); }); !ok) return ok;
  }
  return {};
}

hal::Result<void> ModbusCarrier::Exchange(const std::string& what,
                                          const std::function<hal::Result<void>()>& exchange) {
  if (socket() >= 0) {
    // Nothing may be waiting now: bytes are an answer nobody asked for, an end of file is a
    // connection that the bender closed while we did not look. Both are cured by a new connection.
    pollfd idle{socket(), POLLIN, 0};
    if (poll(&idle, 1, 0) != 0) Close();
  }
  if (auto ok = Connect(); !ok) return ok;
  auto done = exchange();
  if (done) return done;
  Close();
  return hal::Fail(hal::ErrorKind::kDevice,
                   "bender " + peer() + ": " + what + ": " + done.error().message);
}

}  // namespace bendloop::drivers
