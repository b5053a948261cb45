// SPDX-License-Identifier: Apache-2.0
#include "drivers/stream_scanner/tcp_connection.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <ctime>
#include <memory>
#include <system_error>
#include <utility>

#include "hal/clock.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;
using std::chrono::nanoseconds;

std::string Reason(int code) { return std::generic_category().message(code); }

// True if the socket is ready (or broken, which the next call says).
bool WaitFor(int socket, short events, nanoseconds deadline) {
  const hal::SteadyClock clock;
  pollfd waiting{socket, events, 0};
  while (true) {
    const nanoseconds left = std::max(deadline - clock.Now(), nanoseconds(0));
    const timespec limit{left.count() / 1'000'000'000, left.count() % 1'000'000'000};
    const int ready = ppoll(&waiting, 1, &limit, nullptr);
    if (ready > 0) return true;
    if (ready == 0) return false;
    if (errno != EINTR) return true;
  }
}

}  // namespace

TcpConnection::TcpConnection(TcpConnection&& other) noexcept
    : socket_(std::exchange(other.socket_, -1)), peer_(std::move(other.peer_)) {}

TcpConnection& TcpConnection::operator=(TcpConnection&& other) noexcept {
  if (this != &other) {
    Close();
    socket_ = std::exchange(other.socket_, -1);
    peer_ = std::move(other.peer_);
  }
  return *this;
}

void TcpConnection::Close() {
  if (socket_ >= 0) close(socket_);
  socket_ = -1;
}

hal::Error TcpConnection::Failure(const std::string& what) const {
  return {ErrorKind::kDevice, "scanner at " + peer_ + ": " + what};
}

Result<TcpConnection> TcpConnection::Connect(const std::string& host, std::uint16_t port,
                                             nanoseconds timeout) {
  const nanoseconds deadline = hal::SteadyClock().Now() + timeout;
  TcpConnection connection;
  connection.peer_ = host + ":" + std::to_string(port);
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int code = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
  if (code != 0) {
    return Fail(connection.Failure(std::string("no such host (") + gai_strerror(code) +
                                   "); check the cell file's scanner address"));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, freeaddrinfo);
  int error = ECONNREFUSED;
  for (const addrinfo* address = found; address != nullptr; address = address->ai_next) {
    connection.Close();
    connection.socket_ =
        socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC,
               address->ai_protocol);
    if (connection.socket_ < 0) {
      error = errno;
      continue;
    }
    if (connect(connection.socket_, address->ai_addr, address->ai_addrlen) == 0) {
      error = 0;
    } else if (errno != EINPROGRESS) {
      error = errno;
    } else if (!WaitFor(connection.socket_, POLLOUT, deadline)) {
      error = ETIMEDOUT;
    } else {
      socklen_t size = sizeof(error);
      getsockopt(connection.socket_, SOL_SOCKET, SO_ERROR, &error, &size);
    }
    if (error == 0) break;
  }
  if (error != 0) {
    return Fail(connection.Failure("cannot connect: " + Reason(error) +
                                   "; is the scanner on and its cable in?"));
  }
  const int on = 1;
  setsockopt(connection.socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
  // A scanner that was switched off says nothing more: the kernel asks after it.
  const int idle_s = 5;
  const int count = 3;
  setsockopt(connection.socket_, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof(on));
  setsockopt(connection.socket_, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof(idle_s));
  setsockopt(connection.socket_, IPPROTO_TCP, TCP_KEEPINTVL, &idle_s, sizeof(idle_s));
  setsockopt(connection.socket_, IPPROTO_TCP, TCP_KEEPCNT, &count, sizeof(count));
  return connection;
}

Result<void> TcpConnection::Send(std::span<const std::uint8_t> bytes, nanoseconds timeout) {
  const nanoseconds deadline = hal::SteadyClock().Now() + timeout;
  while (!bytes.empty()) {
    const ssize_t sent = send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent > 0) {
      bytes = bytes.subspan(static_cast<std::size_t>(sent));
    } else if (errno == EAGAIN) {
      if (!WaitFor(socket_, POLLOUT, deadline)) return Fail(Failure("takes no requests"));
    } else if (errno != EINTR) {
      return Fail(Failure("cannot send: " + Reason(errno)));
    }
  }
  return {};
}

Result<std::size_t> TcpConnection::Receive(std::span<std::uint8_t> bytes, nanoseconds timeout) {
  bool waited = false;
  while (true) {
    const ssize_t got = recv(socket_, bytes.data(), bytes.size(), 0);
    if (got > 0) return static_cast<std::size_t>(got);
    if (got == 0) return Fail(Failure("closed the connection"));
    if (errno == EAGAIN) {
      if (waited || timeout <= nanoseconds(0)) return std::size_t{0};
      waited = true;
      if (!WaitFor(socket_, POLLIN, hal::SteadyClock().Now() + timeout)) return std::size_t{0};
    } else if (errno != EINTR) {
      return Fail(Failure("connection lost: " + Reason(errno)));
    }
  }
}

}  // namespace bendloop::drivers
