// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/moment.h"

#include <algorithm>
#include <cstdio>
#include <ctime>

namespace bendloop::host {
namespace {

std::int64_t Nanoseconds(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

}  // namespace

Moment SystemMoment() {
  return {Nanoseconds(CLOCK_BOOTTIME), Nanoseconds(CLOCK_REALTIME) / 1'000'000};
}

double SecondsBetween(const Moment& then, const Moment& now) {
  return std::max(static_cast<double>(now.boot_ns - then.boot_ns) * 1e-9,
                  static_cast<double>(now.unix_ms - then.unix_ms) * 1e-3);
}

std::string UtcText(std::int64_t unix_ms) {
  const std::time_t seconds = unix_ms / 1000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[64];
  const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text + length, sizeof text - length, ".%03dZ", static_cast<int>(unix_ms % 1000));
  return text;
}

std::optional<std::int64_t> ParseUtc(const std::string& text) {
  std::tm utc{};
  const char* const rest = strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &utc);
  if (rest == nullptr) return std::nullopt;
  double fraction_s = 0;
  int used = 0;
  if (*rest == '.' && std::sscanf(rest, "%lf%n", &fraction_s, &used) != 1) return std::nullopt;
  if (rest[used] != 'Z' || rest[used + 1] != '\0') return std::nullopt;
  return static_cast<std::int64_t>(timegm(&utc)) * 1000 +
         static_cast<std::int64_t>(fraction_s * 1e3 + 0.5);
}

}  // namespace bendloop::host
