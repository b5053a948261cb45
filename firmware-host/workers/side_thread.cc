// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/workers/side_thread.h"

#include <pthread.h>

#include <utility>

namespace bendloop::host {

SideThread::~SideThread() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  begin_.notify_one();
  thread_.join();
}

void SideThread::Do(const std::function<void()>& work, std::chrono::nanoseconds period,
                    const std::function<void()>& meanwhile) {
  if (!thread_.joinable()) thread_ = std::thread([this] { Run(); });
  std::unique_lock lock(mutex_);
  work_ = &work;
  begin_.notify_one();
  const auto is_done = [this] { return work_ == nullptr; };
  std::exception_ptr own;
  while (!done_.wait_for(lock, period, is_done)) {
    lock.unlock();
    // The work uses what the caller has: it must have ended before anything leaves here.
    try {
      if (!own) meanwhile();
    } catch (...) {
      own = std::current_exception();
    }
    lock.lock();
  }
  const std::exception_ptr thrown = std::exchange(thrown_, nullptr);
  if (thrown || own) std::rethrow_exception(thrown ? thrown : own);
}

void SideThread::Run() {
  pthread_setname_np(pthread_self(), "beside-loop");
  std::unique_lock lock(mutex_);
  while (true) {
    begin_.wait(lock, [this] { return stop_ || work_ != nullptr; });
    if (stop_) return;
    const std::function<void()>& work = *work_;
    lock.unlock();
    std::exception_ptr thrown;
    try {
      work();
    } catch (...) {
      thrown = std::current_exception();
    }
    lock.lock();
    thrown_ = std::move(thrown);
    work_ = nullptr;
    done_.notify_one();
  }
}

}  // namespace bendloop::host
