// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/simulated_scanner.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>
#include <system_error>
#include <utility>

#include "drivers/simulated_scanner/virtual_scan_source.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;
using std::chrono::nanoseconds;

constexpr int kMostRoundsAPoll = 16;

hal::Error SocketError(const std::string& what) {
  return {ErrorKind::kDevice,
          "simulated scanner: " + what + ": " + std::generic_category().message(errno)};
}

}  // namespace

Result<std::unique_ptr<SimulatedScanner>> SimulatedScanner::Listen(std::uint16_t port,
                                                                   WireIdentity identity,
                                                                   hal::Clock& clock) {
  std::unique_ptr<SimulatedScanner> scanner(new SimulatedScanner(std::move(identity), clock));
  scanner->listener_ = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (scanner->listener_ < 0) return Fail(SocketError("cannot make a socket"));
  const int on = 1;
  setsockopt(scanner->listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  if (bind(scanner->listener_, generic, size) != 0 || listen(scanner->listener_, 4) != 0 ||
      getsockname(scanner->listener_, generic, &size) != 0) {
    return Fail(SocketError("cannot listen on 127.0.0.1:" + std::to_string(port)));
  }
  scanner->port_ = ntohs(address.sin_port);
  return scanner;
}

SimulatedScanner::~SimulatedScanner() {
  if (host_ >= 0) close(host_);
  if (listener_ >= 0) close(listener_);
}

void SimulatedScanner::Trigger(std::shared_ptr<const VirtualScan> scan, ScanPace pace) {
  device_.Trigger(std::make_unique<VirtualScanSource>(std::move(scan)), pace);
}

void SimulatedScanner::Accept() {
  while (true) {
    const int taken = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (taken < 0) return;
    if (host_ >= 0) {
      close(taken);  // one host at a time
      continue;
    }
    const int on = 1;
    setsockopt(taken, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    host_ = taken;
    device_.HostCame();
  }
}

void SimulatedScanner::DropHost() {
  if (host_ >= 0) close(host_);
  host_ = -1;
  device_.HostWent();
}

void SimulatedScanner::ReceiveRequests() {
  std::array<std::uint8_t, 4096> bytes{};
  while (host_ >= 0) {
    const ssize_t got = recv(host_, bytes.data(), bytes.size(), 0);
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return DropHost();
    if (got < 0) return;
    device_.Receive({bytes.data(), static_cast<std::size_t>(got)});
  }
}

void SimulatedScanner::Flush() {
  while (host_ >= 0 && !device_.Waiting().empty()) {
    const auto waiting = device_.Waiting();
    const ssize_t sent = send(host_, waiting.data(), waiting.size(), MSG_NOSIGNAL);
    if (sent > 0) {
      device_.Sent(static_cast<std::size_t>(sent));
    } else if (errno == EAGAIN) {
      return;
    } else if (errno != EINTR) {
      return DropHost();
    }
  }
  if (host_ >= 0 && device_.TakeCarrierFault()) DropHost();
}

void SimulatedScanner::SendDue() {
  Flush();
  for (int i = 0; i < kMostRoundsAPoll && host_ >= 0 && device_.UntilDue() == nanoseconds(0); ++i) {
    device_.Work();
    Flush();
    if (!device_.Waiting().empty()) return;  // the host is busy
  }
}

Result<void> SimulatedScanner::Poll(nanoseconds timeout) {
  ReceiveRequests();  // first, to see that a host has left before the next one knocks
  Accept();
  SendDue();
  const bool is_blocked = !device_.Waiting().empty();
  nanoseconds wait = timeout;
  if (host_ >= 0 && !is_blocked) wait = std::min(wait, device_.UntilDue());
  if (wait <= nanoseconds(0)) return {};
  std::array<pollfd, 3> waiting = {
      pollfd{listener_, POLLIN, 0},
      pollfd{host_, static_cast<short>(is_blocked ? POLLIN | POLLOUT : POLLIN), 0},
      pollfd{wake_, POLLIN, 0}};
  const timespec limit{wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
  if (ppoll(waiting.data(), waiting.size(), &limit, nullptr) < 0 && errno != EINTR) {
    return Fail(SocketError("cannot wait"));
  }
  return {};
}

}  // namespace bendloop::drivers
