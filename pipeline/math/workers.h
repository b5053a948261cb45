// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>

namespace bendloop::pipeline {

// Who shares the rounds of the pipeline's loops, handed in by whoever owns the threads
// (firmware-host/workers). Which of them does a round is left to chance, so that a round must be a
// pure function of its number and write only what belongs to it: then the result is the same to the
// bit for any number of threads.
class Workers {
 public:
  using Body = std::function<void(std::size_t round)>;

  virtual ~Workers() = default;

  // How many rounds may run at a time, at least 1.
  virtual std::size_t threads() const = 0;
  // Calls body(0) ... body(rounds - 1), each once, and returns when all have. A loop within a
  // round runs on the round's own thread. A body must not throw.
  virtual void For(std::size_t rounds, const Body& body) = 0;
};

// The loop by workers, or without any: one round after the other.
inline void ParallelFor(Workers* workers, std::size_t rounds, const Workers::Body& body) {
  if (workers) {
    workers->For(rounds, body);
  } else {
    for (std::size_t round = 0; round < rounds; ++round) body(round);
  }
}

}  // namespace bendloop::pipeline
