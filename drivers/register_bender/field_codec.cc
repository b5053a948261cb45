// SPDX-License-Identifier: Apache-2.0
#include "drivers/register_bender/field_codec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::RegisterType;

constexpr double kMaxUint32 = hal::RawRangeOf(RegisterType::kUint32).max;

const char* TypeName(RegisterType type) {
  switch (type) {
    case RegisterType::kUint16:
      return "uint16";
    case RegisterType::kInt16:
      return "int16";
    case RegisterType::kUint32:
      return "uint32";
    case RegisterType::kInt32:
      return "int32";
    case RegisterType::kFloat32:
      return "float32";
    case RegisterType::kUint8:
      return "uint8";
  }
  return "unknown type";
}

std::string Number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.10g", value);
  return text;
}

std::uint16_t SwapBytes(std::uint16_t word) {
  return static_cast<std::uint16_t>(word << 8 | word >> 8);
}

void PutWord(const hal::RegisterMap& map, std::uint16_t word, std::uint16_t* to) {
  *to = map.high_byte_first ? word : SwapBytes(word);
}

std::uint16_t GetWord(const hal::RegisterMap& map, const std::uint16_t* from) {
  return map.high_byte_first ? *from : SwapBytes(*from);
}

// A word with the first character in its high byte, from the wire or to it. The bytes of an object
// travel as they are.
std::uint16_t WordOfText(const hal::RegisterMap& map, std::uint16_t word) {
  return map.of_objects() || map.high_byte_first ? word : SwapBytes(word);
}

}  // namespace

std::string PlaceOf(const hal::RegisterField& field) {
  if (field.object.index != 0) return "object " + hal::Name(field.object);
  return "register " + std::to_string(field.address);
}

RegisterRange RangeOf(const hal::RegisterField& field) {
  return {field.space, field.address, RegisterCount(field.type)};
}

hal::Result<void> PutField(const hal::RegisterMap& map, const hal::RegisterField& field,
                           double value, std::string_view what, RegisterImage& image) {
  const std::string name(what);
  if (!std::isfinite(value)) {
    return hal::Fail(ErrorKind::kBadInput, name + ": " + Number(value) + " is not a finite number");
  }
  const auto [low, high] = hal::RawRangeOf(field.type);
  double raw = (value - field.offset) / field.scale;
  if (field.type != RegisterType::kFloat32) raw = std::round(raw);
  if (!(raw >= low && raw <= high)) {
    const double a = low * field.scale + field.offset;
    const double b = high * field.scale + field.offset;
    return hal::Fail(ErrorKind::kBadInput, name + ": " + Number(value) + " does not fit " +
                                               TypeName(field.type) + " with scale " +
                                               Number(field.scale) + " at " + PlaceOf(field) +
                                               ", which holds " + Number(std::min(a, b)) + " to " +
                                               Number(std::max(a, b)));
  }
  std::uint32_t bits = 0;
  if (field.type == RegisterType::kFloat32) {
    bits = std::bit_cast<std::uint32_t>(static_cast<float>(raw + 0.0));  // never -0
  } else {
    bits = static_cast<std::uint32_t>(static_cast<std::int64_t>(raw));
  }
  std::uint16_t* to = image.At(field.space, field.address);
  if (RegisterCount(field.type) == 1) {
    PutWord(map, static_cast<std::uint16_t>(bits), to);
  } else {
    PutWord(map, static_cast<std::uint16_t>(bits >> 16), to + (map.high_word_first ? 0 : 1));
    PutWord(map, static_cast<std::uint16_t>(bits), to + (map.high_word_first ? 1 : 0));
  }
  return {};
}

hal::Result<double> GetField(const hal::RegisterMap& map, const hal::RegisterField& field,
                             std::string_view what, const RegisterImage& image) {
  const std::uint16_t* from = image.At(field.space, field.address);
  std::uint32_t bits = GetWord(map, from);
  if (RegisterCount(field.type) == 2) {
    const std::uint32_t second = GetWord(map, from + 1);
    bits = map.high_word_first ? bits << 16 | second : second << 16 | bits;
  }
  double raw = bits;
  if (field.type == RegisterType::kInt16) raw = static_cast<std::int16_t>(bits);
  if (field.type == RegisterType::kInt32) raw = static_cast<std::int32_t>(bits);
  if (field.type == RegisterType::kFloat32) raw = std::bit_cast<float>(bits);
  if (!std::isfinite(raw)) {
    return hal::Fail(ErrorKind::kDevice, std::string(what) + ": " + PlaceOf(field) + " holds " +
                                             Number(raw) + " where a number was expected");
  }
  return raw * field.scale + field.offset;
}

hal::Result<std::uint32_t> GetInteger(const hal::RegisterMap& map, const hal::RegisterField& field,
                                      std::string_view what, const RegisterImage& image) {
  const auto value = GetField(map, field, what, image);
  if (!value) return hal::Fail(value.error());
  const double whole = std::round(*value);
  if (std::abs(*value - whole) > 1e-6 || whole < 0 || whole > kMaxUint32) {
    return hal::Fail(ErrorKind::kDevice, std::string(what) + ": " + PlaceOf(field) + " holds " +
                                             Number(*value) +
                                             " where a whole number from 0 was expected");
  }
  return static_cast<std::uint32_t>(whole);
}

std::optional<std::string> GetText(const hal::RegisterMap& map, const hal::TextField& field,
                                   const RegisterImage& image) {
  std::string text;
  for (std::uint16_t i = 0; i < field.characters; ++i) {
    const std::uint16_t word =
        *image.At(field.space, static_cast<std::uint16_t>(field.address + i / 2));
    text += static_cast<char>(WordOfText(map, word) >> (i % 2 == 0 ? 8 : 0) & 0xff);
  }
  text.resize(std::min(text.size(), text.find('\0')));
  text.resize(text.find_last_not_of(' ') + 1);
  const bool is_text =
      std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
  return is_text ? std::optional(text) : std::nullopt;
}

void PutText(const hal::RegisterMap& map, const hal::TextField& field, std::string_view text,
             RegisterImage& image) {
  const auto at = [&](std::size_t i) {
    return i < text.size() && i < field.characters ? static_cast<unsigned char>(text[i]) : 0u;
  };
  for (std::uint16_t i = 0; i < field.registers(); ++i) {
    const auto word = static_cast<std::uint16_t>(at(2u * i) << 8 | at(2u * i + 1));
    *image.At(field.space, static_cast<std::uint16_t>(field.address + i)) = WordOfText(map, word);
  }
}

RegisterRange RangeOf(const hal::TextField& field) {
  return {field.space, field.address, field.registers()};
}

std::uint32_t MaxInteger(const hal::RegisterField& field) {
  constexpr double kMaxExactFloat = 16777216.0;
  double high =
      field.type == RegisterType::kFloat32 ? kMaxExactFloat : hal::RawRangeOf(field.type).max;
  high = std::floor(high * field.scale + field.offset);
  if (!(high > 0)) return 0;
  return high >= kMaxUint32 ? 0xFFFFFFFFu : static_cast<std::uint32_t>(high);
}

}  // namespace bendloop::drivers
