// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/workers/thread_workers.h"

#include <algorithm>
#include <exception>
#include <utility>

namespace bendloop::host {

ThreadWorkers::ThreadWorkers(std::size_t threads, const Starter& start) {
  if (threads > 1) threads_.reserve(threads - 1);
  // An exception must not leave the constructor once a thread waits: nobody would stop it, and the
  // end of `threads_` would wait for it for ever.
  try {
    for (std::size_t i = 1; i < threads; ++i) threads_.push_back(start([this] { Work(); }));
  } catch (const std::exception&) {
  }
}

std::jthread ThreadWorkers::StartThread(std::function<void()> work) {
  return std::jthread(std::move(work));
}

ThreadWorkers::~ThreadWorkers() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_.notify_all();
}

void ThreadWorkers::For(std::size_t rounds, const Body& body) {
  std::unique_lock lock(mutex_);
  if (threads_.empty() || rounds < 2 || body_ != nullptr) {
    lock.unlock();
    for (std::size_t round = 0; round < rounds; ++round) body(round);
    return;
  }
  body_ = &body;
  next_ = 0;
  rounds_ = rounds;
  lock.unlock();
  work_.notify_all();
  lock.lock();
  TakeRounds(lock);
  // Who wakes up too late finds nothing to do and is not waited for.
  done_.wait(lock, [this] { return inside_ == 0; });
  body_ = nullptr;
  if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
}

void ThreadWorkers::Work() {
  std::unique_lock lock(mutex_);
  while (true) {
    work_.wait(lock, [this] { return stop_ || next_ < rounds_; });
    if (stop_) return;
    TakeRounds(lock);
    if (inside_ == 0) done_.notify_one();
  }
}

void ThreadWorkers::TakeRounds(std::unique_lock<std::mutex>& lock) noexcept {
  ++inside_;
  while (next_ < rounds_) {
    const std::size_t round = next_++;
    lock.unlock();
    std::exception_ptr thrown;
    try {
      (*body_)(round);
    } catch (...) {
      thrown = std::current_exception();
    }
    lock.lock();
    if (!thrown) continue;
    if (!thrown_) thrown_ = std::move(thrown);
    next_ = rounds_;
  }
  --inside_;
}

std::size_t ProcessorCount() { return std::max(1U, std::thread::hardware_concurrency()); }

}  // namespace bendloop::host
