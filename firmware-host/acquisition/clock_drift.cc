// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acquisition/clock_drift.h"

#include <cmath>

namespace bendloop::host {
namespace {

constexpr std::int64_t kFirstStretchNs = 250'000'000;
constexpr std::int64_t kLeastNs = 5'000'000'000;
constexpr double kMostPpm = 10'000;

// Times of a damaged device may be any numbers.
std::int64_t Since(std::int64_t from, std::int64_t to) {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(to) -
                                   static_cast<std::uint64_t>(from));
}

}  // namespace

void ClockDrift::Add(std::int64_t device_ns, std::int64_t host_ns) {
  if (count_ == 0 || device_ns < last_device_ns_) {
    count_ = 0;
    stretch_ns_ = kFirstStretchNs;
    first_device_ns_ = device_ns;
    first_host_ns_ = host_ns;
    stretch_end_ns_ = 0;
  }
  last_device_ns_ = device_ns;
  const std::int64_t at = Since(first_device_ns_, device_ns);
  const std::int64_t delay = Since(at, Since(first_host_ns_, host_ns));
  if (count_ > 0 && at < stretch_end_ns_) {
    if (delay < floors_[count_ - 1].delay_ns) floors_[count_ - 1] = {at, delay};
    return;
  }
  if (count_ == floors_.size()) Merge();
  floors_[count_++] = {at, delay};
  stretch_end_ns_ = at < INT64_MAX - stretch_ns_ ? at + stretch_ns_ : INT64_MAX;
}

void ClockDrift::Merge() {
  for (std::size_t i = 0; i < count_ / 2; ++i) {
    const Floor& a = floors_[2 * i];
    const Floor& b = floors_[2 * i + 1];
    floors_[i] = a.delay_ns < b.delay_ns ? a : b;
  }
  count_ /= 2;
  if (stretch_ns_ < INT64_MAX / 2) stretch_ns_ *= 2;
}

std::optional<double> ClockDrift::Ppm() const {
  if (count_ < 5 || floors_[count_ - 1].at_ns < kLeastNs) return std::nullopt;
  // Not the last: its stretch is not over, and a single late profile is no floor.
  const std::size_t whole = count_ - 1;
  double mean_at = 0;
  double mean_delay = 0;
  const auto n = static_cast<double>(whole);
  for (std::size_t i = 0; i < whole; ++i) {
    mean_at += static_cast<double>(floors_[i].at_ns) / n;
    mean_delay += static_cast<double>(floors_[i].delay_ns) / n;
  }
  double both = 0;
  double square = 0;
  for (std::size_t i = 0; i < whole; ++i) {
    const double at = static_cast<double>(floors_[i].at_ns) - mean_at;
    both += at * (static_cast<double>(floors_[i].delay_ns) - mean_delay);
    square += at * at;
  }
  // A fast clock counts more than has passed: its delays fall. host = device / (1 + drift).
  const double slope = both / square;
  const double ppm = -slope / (1 + slope) * 1e6;
  if (!(std::abs(ppm) <= kMostPpm)) return std::nullopt;
  return ppm;
}

}  // namespace bendloop::host
