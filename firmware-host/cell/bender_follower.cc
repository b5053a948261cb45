// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_follower.h"

#include <pthread.h>

#include <algorithm>
#include <utility>

#include "firmware-host/workers/want_of_memory.h"

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

BenderFollower::BenderFollower(BenderDesk& desk, PlcReporter* reporter, StatusBoard& board)
    : desk_(desk), reporter_(reporter), board_(board), thread_([this] { Run(); }) {}

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

std::optional<std::chrono::nanoseconds> BenderFollower::Look(BenderReading& now,
                                                             BenderReading& copy) {
  const std::int64_t asked_ns = desk_.Now().boot_ns;
  const bool has_memory = HasMemoryFor([&] {
    now = desk_.Look();
    copy = now;
  });
  if (!has_memory) {
    board_.OutOfMemory("a look at the bender");
    return std::nullopt;
  }
  return std::chrono::nanoseconds(desk_.Now().boot_ns - asked_ns);
}

void BenderFollower::Run() {
  pthread_setname_np(pthread_self(), "bender");
  std::unique_lock lock(mutex_);
  while (!stop_) {
    look_now_ = false;
    const std::uint64_t number = ++begun_;
    lock.unlock();
    BenderReading now, copy;
    const auto took = Look(now, copy);
    const auto pause = took ? PauseAfter(now, *took) : kPeriod;
    const bool answers = took && now.facts;
    lock.lock();
    if (took) {
      latest_ = std::move(copy);
      news_ = std::move(now);
      ended_ = number;
      answered_.notify_all();
    }
    if (reporter_ != nullptr && answers) {
      lock.unlock();
      if (!HasMemoryFor([this] { reporter_->Write(desk_); })) {
        board_.OutOfMemory("what the PLC reads of the cell");
      }
      lock.lock();
    }
    wake_.wait_for(lock, pause, [this] { return stop_ || look_now_; });
  }
}

}  // namespace bendloop::host
