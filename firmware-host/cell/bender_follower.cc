// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_follower.h"

#include <pthread.h>

#include <utility>

namespace bendloop::host {
namespace {

// Shorter than any cycle of a press, long enough for a slow serial line.
constexpr std::chrono::milliseconds kPeriod{250};

}  // namespace

BenderFollower::BenderFollower(BenderDesk& desk) : desk_(desk), thread_([this] { Run(); }) {}

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

std::optional<BenderReading> BenderFollower::TakeNews() {
  const std::lock_guard lock(mutex_);
  return std::exchange(news_, std::nullopt);
}

void BenderFollower::Run() {
  pthread_setname_np(pthread_self(), "bender");
  std::unique_lock lock(mutex_);
  while (!stop_) {
    look_now_ = false;
    lock.unlock();
    BenderReading now = desk_.Look();
    lock.lock();
    news_ = std::move(now);
    wake_.wait_for(lock, kPeriod, [this] { return stop_ || look_now_; });
  }
}

}  // namespace bendloop::host
