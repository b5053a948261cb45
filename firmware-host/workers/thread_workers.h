// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "pipeline/math/workers.h"

namespace bendloop::host {

// The pipeline's workers as threads of this process. They begin with this object and end with it.
class ThreadWorkers final : public pipeline::Workers {
 public:
  using Starter = std::function<std::jthread(std::function<void()> work)>;

  // `threads` work at a time, the caller's among them: 1 or 0 starts none. Where one cannot be
  // started (limits of processes or memory), those that could share the work. `start` throws as
  // std::jthread does.
  explicit ThreadWorkers(std::size_t threads, const Starter& start = StartThread);
  ThreadWorkers(const ThreadWorkers&) = delete;
  ThreadWorkers& operator=(const ThreadWorkers&) = delete;
  ~ThreadWorkers() override;

  // As many as work, which may be fewer than were asked for.
  std::size_t threads() const override { return threads_.size() + 1; }
  // What a round throws is thrown here, when no thread works any more; rounds that had not begun
  // are left out then. Of several the first.
  void For(std::size_t rounds, const Body& body) override;

 private:
  static std::jthread StartThread(std::function<void()> work);
  void Work();
  // Takes rounds until none is left; `lock` is held between them.
  void TakeRounds(std::unique_lock<std::mutex>& lock) noexcept;

  std::mutex mutex_;
  std::condition_variable work_, done_;
  const Body* body_ = nullptr;  // of the loop that runs
  std::size_t next_ = 0, rounds_ = 0;
  std::size_t inside_ = 0;     // threads that have not finished their round
  std::exception_ptr thrown_;  // by a round
  bool stop_ = false;
  std::vector<std::jthread> threads_;  // last: they use the others
};

// As many as there are processors.
std::size_t ProcessorCount();

}  // namespace bendloop::host
