// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <microhttpd.h>

#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>

namespace bendloop::host {

// Closes connections of libmicrohttpd that last too long as a whole: it knows a time-out for silent
// ones only, and who sends a byte now and then keeps a connection that others wait for. Serves
// several daemons, and must outlive them.
class Doorkeeper {
 public:
  explicit Doorkeeper(std::chrono::seconds patience);
  Doorkeeper(const Doorkeeper&) = delete;
  Doorkeeper& operator=(const Doorkeeper&) = delete;
  ~Doorkeeper();

  // For MHD_OPTION_NOTIFY_CONNECTION, with the doorkeeper as `self`. The library tells of each
  // beginning and end, and closes a descriptor only after it has told of the end.
  static void Note(void* self, MHD_Connection* connection, void** state,
                   MHD_ConnectionNotificationCode what);

 private:
  using Clock = std::chrono::steady_clock;

  void Watch();

  const std::chrono::seconds patience_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::map<int, Clock::time_point> open_;  // descriptors, and until when
  bool stops_ = false;
  std::thread thread_;  // begins when all the rest is there
};

}  // namespace bendloop::host
