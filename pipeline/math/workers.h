// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace bendloop::pipeline {

// Threads that share the rounds of loops. Which of them does a round is left to chance, so that a
// round must be a pure function of its number and write only what belongs to it: then the result is
// the same to the bit for any number of threads.
class Workers {
 public:
  using Body = std::function<void(std::size_t round)>;
  using Starter = std::function<std::jthread(std::function<void()> work)>;

  // `threads` work at a time, the caller's among them: 1 or 0 starts none. Where one cannot be
  // started (limits of processes or memory), those that could share the work. `start` throws as
  // std::jthread does.
  explicit Workers(std::size_t threads, const Starter& start = StartThread);
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  ~Workers();

  // As many as work, which may be fewer than were asked for.
  std::size_t threads() const { return threads_.size() + 1; }

  // Calls body(0) ... body(rounds - 1), each once, and returns when all have. A loop within a
  // round runs on the round's own thread. A body must not throw.
  void For(std::size_t rounds, const Body& body);

 private:
  static std::jthread StartThread(std::function<void()> work);
  void Work();
  // Takes rounds until none is left; `lock` is held between them.
  void TakeRounds(std::unique_lock<std::mutex>& lock) noexcept;

  std::mutex mutex_;
  std::condition_variable work_, done_;
  const Body* body_ = nullptr;  // of the loop that runs
  std::size_t next_ = 0, rounds_ = 0;
  std::size_t inside_ = 0;  // threads that have not finished their round
  bool stop_ = false;
  std::vector<std::jthread> threads_;  // last: they use the others
};

// The same without workers: one after the other.
inline void ParallelFor(Workers* workers, std::size_t rounds, const Workers::Body& body) {
  if (workers) {
    workers->For(rounds, body);
  } else {
    for (std::size_t round = 0; round < rounds; ++round) body(round);
  }
}

}  // namespace bendloop::pipeline
