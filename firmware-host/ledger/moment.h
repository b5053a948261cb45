// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

namespace bendloop::host {

// A point in time by two clocks: one that neither stops while the machine sleeps nor jumps when
// somebody sets the time, and the wall clock, which recordings carry.
struct Moment {
  std::int64_t boot_ns = 0;  // CLOCK_BOOTTIME
  std::int64_t unix_ms = 0;  // CLOCK_REALTIME
};

Moment SystemMoment();

// The longer of what the two clocks say: a clock that was set, or one that stood still, must not
// make anything younger than it is.
double SecondsBetween(const Moment& then, const Moment& now);

// "2026-11-21T03:07:34.123Z", and back; empty for any other text.
std::string UtcText(std::int64_t unix_ms);
std::optional<std::int64_t> ParseUtc(const std::string& text);

}  // namespace bendloop::host
