// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_digest.h"

#include <array>
#include <bit>
#include <cinttypes>
#include <cstdio>
#include <cstring>

#include "drivers/scanner_wire/crc32c.h"
#include "drivers/session/session_blob.h"

namespace bendloop::drivers {
namespace {

std::array<std::uint8_t, 8> BytesOf(std::int64_t value) {
  const std::uint64_t raw = LittleEndian(std::bit_cast<std::uint64_t>(value));
  std::array<std::uint8_t, 8> bytes{};
  std::memcpy(bytes.data(), &raw, sizeof(raw));
  return bytes;
}

// With its length, so that a letter that moves from one text to the next is seen.
std::uint32_t TextSum(std::string_view text, std::uint32_t before) {
  before = Crc32c(BytesOf(static_cast<std::int64_t>(text.size())), before);
  return Crc32c({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, before);
}

}  // namespace

std::uint32_t ProfileSum(std::int64_t sequence, std::int64_t t_ns,
                         std::span<const unsigned char> pose, std::span<const unsigned char> points,
                         std::span<const unsigned char> intensity) {
  std::uint32_t sum = Crc32c(BytesOf(sequence));
  sum = Crc32c(BytesOf(t_ns), sum);
  sum = Crc32c(pose, sum);
  sum = Crc32c(points, sum);
  return Crc32c(intensity, sum);
}

void SessionDigest::AddEvent(std::int64_t t_ns, std::string_view kind, std::string_view detail) {
  Add(events_, TextSum(detail, TextSum(kind, Crc32c(BytesOf(t_ns)))));
}

void SessionDigest::AddMeta(std::string_view key, std::string_view value) {
  Add(entries_, TextSum(value, TextSum(key, 0)));
}

std::string SessionDigest::Text() const {
  std::array<char, 128> text{};
  std::snprintf(text.data(), text.size(),
                "%" PRIu64 " profiles, %" PRIu64 " events, %" PRIu64 " entries, %016" PRIx64,
                profiles_, events_, entries_, sum_);
  return text.data();
}

}  // namespace bendloop::drivers
