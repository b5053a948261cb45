// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace bendloop::host {

// A thread beside its owner's, which does one thing at a time. It begins with the first of them,
// with the priority that the owner has then, and stays: what has once begun needs no memory for a
// thread.
class SideThread {
 public:
  SideThread() = default;
  SideThread(const SideThread&) = delete;
  SideThread& operator=(const SideThread&) = delete;
  ~SideThread();

  // Returns when `work` is done, and calls `meanwhile` again and again until then. What either
  // throws is thrown here, when the work has ended.
  void Do(const std::function<void()>& work, std::chrono::nanoseconds period,
          const std::function<void()>& meanwhile);

 private:
  void Run();

  std::mutex mutex_;  // of all below
  std::condition_variable begin_, done_;
  const std::function<void()>* work_ = nullptr;
  std::exception_ptr thrown_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace bendloop::host
