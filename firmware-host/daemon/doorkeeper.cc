// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/doorkeeper.h"

#include <sys/socket.h>

#include <algorithm>

#include "firmware-host/workers/want_of_memory.h"

namespace bendloop::host {

Doorkeeper::Doorkeeper(std::chrono::seconds patience)
    : patience_(patience), thread_([this] { Watch(); }) {}

Doorkeeper::~Doorkeeper() {
  {
    const std::lock_guard lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void Doorkeeper::Note(void* self, MHD_Connection* connection, void** /*state*/,
                      MHD_ConnectionNotificationCode what) {
  const int socket =
      MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
  auto& keeper = *static_cast<Doorkeeper*>(self);
  const std::lock_guard lock(keeper.mutex_);
  if (what == MHD_CONNECTION_NOTIFY_STARTED) {
    if (HasMemoryFor([&] { keeper.open_[socket] = Clock::now() + keeper.patience_; })) {
      keeper.wake_.notify_all();
    } else {
      ::shutdown(socket, SHUT_RDWR);  // nobody could end it later
    }
  } else {
    keeper.open_.erase(socket);
  }
}

void Doorkeeper::Watch() {
  std::unique_lock lock(mutex_);
  while (!stops_) {
    auto next = Clock::time_point::max();
    const auto now = Clock::now();
    for (auto each = open_.begin(); each != open_.end();) {
      if (each->second > now) {
        next = std::min(next, each->second);
        ++each;
        continue;
      }
      ::shutdown(each->first, SHUT_RDWR);  // the server closes it, and tells
      each = open_.erase(each);
    }
    if (next == Clock::time_point::max()) {
      wake_.wait(lock);
    } else {
      wake_.wait_until(lock, next);
    }
  }
}

}  // namespace bendloop::host
