// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_follower.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

namespace bendloop::host {
namespace {

// Shorter than any cycle of a press, long enough for a slow serial line.
constexpr std::chrono::milliseconds kPeriod{250};
constexpr std::chrono::milliseconds kCyclePeriod{50};

}  // namespace

std::chrono::nanoseconds PauseAfter(const BenderReading& look, std::chrono::nanoseconds took) {
  if (!look.facts || look.facts->state.mode != hal::BenderMode::kBending) return kPeriod;
  return std::clamp<std::chrono::nanoseconds>(took, kCyclePeriod, kPeriod);
}

BenderFollower::BenderFollower(BenderDesk& desk, PlcReporter* reporter)
    : desk_(desk), reporter_(reporter), thread_([this] { Run(); }) {}

BenderFollower::~BenderFollower() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void BenderFollower::LookNow() {
  {
    const std::lock_guard lock(mutex_);
    look_now_ = true;
  }
  wake_.notify_all();
}

std::optional<BenderReading> BenderFollower::LookWithin(std::chrono::nanoseconds patience) {
  std::unique_lock lock(mutex_);
  const std::uint64_t before = begun_;
  look_now_ = true;
  wake_.notify_all();
  if (!answered_.wait_for(lock, patience, [&] { return ended_ > before; })) return std::nullopt;
  return latest_;
}

std::optional<BenderReading> BenderFollower::TakeNews() {
  const std::lock_guard lock(mutex_);
  return std::exchange(news_, std::nullopt);
}

void BenderFollower::Run() {
  pthread_setname_np(pthread_self(), "bender");
  std::unique_lock lock(mutex_);
  while (!stop_) {
    look_now_ = false;
    const std::uint64_t number = ++begun_;
    lock.unlock();
    const std::int64_t asked_ns = desk_.Now().boot_ns;
    BenderReading now = desk_.Look();
    const std::chrono::nanoseconds took(desk_.Now().boot_ns - asked_ns);
    lock.lock();
    const auto pause = PauseAfter(now, took);
    latest_ = now;
    news_ = std::move(now);
    ended_ = number;
    answered_.notify_all();
    if (reporter_ != nullptr && latest_->facts) {
      lock.unlock();
      reporter_->Write(desk_);
      lock.lock();
    }
    wake_.wait_for(lock, pause, [this] { return stop_ || look_now_; });
  }
}

}  // namespace bendloop::host
