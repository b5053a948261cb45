// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/sdo_wire.h"

#include <cstdio>

namespace bendloop::drivers {
namespace {

struct AbortName {
  std::uint32_t code;
  const char* text;
};

// CiA 301, table of SDO abort codes.
constexpr AbortName kAbortNames[] = {
    {0x05030000, "toggle bit not alternated"},
    {0x05040000, "SDO protocol timed out"},
    {0x05040001, "command specifier not valid or unknown"},
    {0x05040002, "block size not valid"},
    {0x05040003, "sequence number not valid"},
    {0x05040004, "crc error"},
    {0x05040005, "out of memory"},
    {0x06010000, "unsupported access to an object"},
    {0x06010001, "the object can only be written"},
    {0x06010002, "the object can only be read"},
    {0x06020000, "the object does not exist in the object dictionary"},
    {0x06040041, "the object cannot be mapped to a PDO"},
    {0x06040042, "mapped objects would exceed the PDO's length"},
    {0x06040043, "general parameter incompatibility"},
    {0x06040047, "general internal incompatibility in the device"},
    {0x06060000, "access failed because of a hardware error"},
    {0x06070010, "data type does not match, length of parameter does not match"},
    {0x06070012, "data type does not match, parameter too long"},
    {0x06070013, "data type does not match, parameter too short"},
    {0x06090011, "the sub-index does not exist"},
    {0x06090030, "value not valid"},
    {0x06090031, "value too high"},
    {0x06090032, "value too low"},
    {0x06090036, "maximum is less than minimum"},
    {0x060A0023, "resource not available"},
    {0x08000000, "general error"},
    {0x08000020, "data cannot be transferred or stored"},
    {0x08000021, "data cannot be transferred or stored because of local control"},
    {0x08000022, "data cannot be transferred or stored in the present device state"},
    {0x08000023, "no object dictionary, or it could not be made"},
    {0x08000024, "no data available"}};

}  // namespace

std::string AbortText(std::uint32_t code) {
  const char* name = "an abort code that CiA 301 does not name";
  for (const AbortName& known : kAbortNames) {
    if (known.code == code) name = known.text;
  }
  char text[128];
  std::snprintf(text, sizeof text, "0x%08X, %s", static_cast<unsigned>(code), name);
  return text;
}

std::uint16_t SdoCrc(std::span<const std::uint8_t> data) {
  std::uint32_t crc = 0;
  for (const std::uint8_t byte : data) {
    crc ^= static_cast<std::uint32_t>(byte) << 8;
    for (int bit = 0; bit < 8; ++bit) crc = crc << 1 ^ (crc & 0x8000u ? 0x1021u : 0u);
    crc &= 0xffff;
  }
  return static_cast<std::uint16_t>(crc);
}

SdoData SdoFrame(std::uint8_t command, ObjectId object, std::uint32_t value) {
  return {command,
          static_cast<std::uint8_t>(object.index),
          static_cast<std::uint8_t>(object.index >> 8),
          object.sub,
          static_cast<std::uint8_t>(value),
          static_cast<std::uint8_t>(value >> 8),
          static_cast<std::uint8_t>(value >> 16),
          static_cast<std::uint8_t>(value >> 24)};
}

std::uint32_t SdoValue(const SdoData& frame) {
  return frame[4] | static_cast<std::uint32_t>(frame[5]) << 8 |
         static_cast<std::uint32_t>(frame[6]) << 16 | static_cast<std::uint32_t>(frame[7]) << 24;
}

ObjectId SdoObject(const SdoData& frame) {
  return {static_cast<std::uint16_t>(frame[1] | frame[2] << 8), frame[3]};
}

}  // namespace bendloop::drivers
