// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <readerwriterqueue/readerwritercircularbuffer.h>
#include <semaphore.h>

#include <cerrno>
#include <chrono>
#include <cstddef>
#include <ctime>
#include <utility>

namespace bendloop::hal {

// A queue of bounded length between one writer and one reader; it never allocates nor takes a lock.
// The queue's own wait goes by the wall clock, so that a clock which somebody sets back by an hour
// in the middle of 20 ms makes an hour of them; this one's goes by a clock that nobody sets.
template <class T>
class BoundedQueue {
 public:
  explicit BoundedQueue(std::size_t capacity) : ring_(capacity) { sem_init(&items_, 0, 0); }
  BoundedQueue(const BoundedQueue&) = delete;
  BoundedQueue& operator=(const BoundedQueue&) = delete;
  ~BoundedQueue() { sem_destroy(&items_); }

  // Writer: false when it is full.
  bool TryPut(T item) {
    if (!ring_.try_enqueue(std::move(item))) return false;
    sem_post(&items_);
    return true;
  }

  // Reader: false when there is nothing.
  bool TryTake(T& item) { return sem_trywait(&items_) == 0 && ring_.try_dequeue(item); }

  // Reader: the same, after so long; a signal does not end the wait.
  bool TakeWithin(T& item, std::chrono::nanoseconds timeout) {
    if (TryTake(item)) return true;
    if (timeout.count() <= 0) return false;
    constexpr long kSecond_ns = 1'000'000'000;
    timespec until{};
    clock_gettime(CLOCK_MONOTONIC, &until);
    const auto sum_ns = until.tv_nsec + timeout.count() % kSecond_ns;
    until.tv_sec += timeout.count() / kSecond_ns + sum_ns / kSecond_ns;
    until.tv_nsec = sum_ns % kSecond_ns;
    int result = 0;
    do {
      result = sem_clockwait(&items_, CLOCK_MONOTONIC, &until);
    } while (result != 0 && errno == EINTR);
    return result == 0 && ring_.try_dequeue(item);
  }

  // Either side.
  std::size_t size_approx() const { return ring_.size_approx(); }

 private:
  moodycamel::BlockingReaderWriterCircularBuffer<T> ring_;
  sem_t items_;  // one for each item of the ring
};

}  // namespace bendloop::hal
