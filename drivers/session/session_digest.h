// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace bendloop::drivers {

// CRC-32C of one row of table profile: seq, t_ns (little-endian, 8 bytes each), then the bytes of
// pose, points and intensity.
std::uint32_t ProfileSum(std::int64_t sequence, std::int64_t t_ns,
                         std::span<const unsigned char> pose, std::span<const unsigned char> points,
                         std::span<const unsigned char> intensity);

// What a whole session holds, whatever the order in which it came: how many rows, and the sum of
// their CRC-32C modulo 2^64. A row that is missing, one too many or altered changes it.
class SessionDigest {
 public:
  void AddProfile(std::uint32_t sum) { Add(profiles_, sum); }
  void AddEvent(std::int64_t t_ns, std::string_view kind, std::string_view detail);
  // Not for the digest's own entry.
  void AddMeta(std::string_view key, std::string_view value);

  // "3 profiles, 2 events, 8 entries, 00000001c0ffee42".
  std::string Text() const;

 private:
  void Add(std::uint64_t& count, std::uint32_t sum) {
    ++count;
    sum_ += sum;
  }
  std::uint64_t profiles_ = 0;
  std::uint64_t events_ = 0;
  std::uint64_t entries_ = 0;
  std::uint64_t sum_ = 0;
};

}  // namespace bendloop::drivers
