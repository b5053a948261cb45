// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <list>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "firmware-host/daemon/http_answer.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostConnections = 64;
constexpr auto kPatience = std::chrono::seconds(2);  // of a connection, from its first moment
constexpr int kBacklog = 64;

std::string ErrorText(int error_number) { return std::generic_category().message(error_number); }

class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  int number() const { return number_; }

 private:
  int number_;
};

hal::Result<Descriptor> ListenOnPort(std::uint16_t& port) {
  const auto fail = [port](int why) {
    return hal::Fail(hal::ErrorKind::kDevice, "status server: 127.0.0.1:" + std::to_string(port) +
                                                  ": " + ErrorText(why) + "; give it another port");
  };
  Descriptor listener(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (listener.number() < 0) return fail(errno);
  // A daemon that starts again takes the port of the one before, whose connections still linger.
  const int yes = 1;
  ::setsockopt(listener.number(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  socklen_t size = sizeof address;
  if (::bind(listener.number(), generic, size) != 0 || ::listen(listener.number(), kBacklog) != 0 ||
      ::getsockname(listener.number(), generic, &size) != 0) {
    return fail(errno);
  }
  port = ntohs(address.sin_port);
  return listener;
}

// For the group that the directory belongs to, which may read what stands in it.
hal::Result<Descriptor> ListenOnSocket(const fs::path& path) {
  const auto fail = [&path](const std::string& why) {
    return hal::Fail(hal::ErrorKind::kDevice, "status server: " + path.string() + ": " + why);
  };
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.string().size() >= sizeof address.sun_path) {
    return fail("longer than a socket's name may be, " +
                std::to_string(sizeof address.sun_path - 1) + "; set a shorter state_dir");
  }
  std::memcpy(address.sun_path, path.c_str(), path.string().size() + 1);
  ::unlink(path.c_str());  // of a daemon that was killed: the state directory is ours by its lock
  Descriptor listener(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  struct stat directory {};
  if (listener.number() < 0 ||
      ::bind(listener.number(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::stat(path.parent_path().c_str(), &directory) != 0 || ::chmod(path.c_str(), 0660) != 0 ||
      ::listen(listener.number(), kBacklog) != 0) {
    return fail(ErrorText(errno));
  }
  // Not ours to give away to that group: then our own is asked for.
  if (::chown(path.c_str(), static_cast<uid_t>(-1), directory.st_gid) != 0 && errno != EPERM) {
    return fail(ErrorText(errno));
  }
  return listener;
}

struct Connection {
  Descriptor socket;
  bool check_host = true;
  Clock::time_point until;
  std::string request;
  std::string answer;  // empty: the request is not whole
  std::size_t sent = 0;
};

}  // namespace

class StatusServer::Impl {
 public:
  Impl(Pages pages, Descriptor port_listener, Descriptor socket_listener, fs::path socket)
      : pages_{{"/status", {"application/json", std::move(pages.status)}},
               {"/metrics", {"text/plain; version=0.0.4", std::move(pages.metrics)}}},
        port_listener_(std::move(port_listener)),
        socket_listener_(std::move(socket_listener)),
        socket_(std::move(socket)),
        stop_(::eventfd(0, EFD_CLOEXEC)),
        thread_([this] { Run(); }) {}

  ~Impl() {
    const std::uint64_t one = 1;
    (void)!::write(stop_.number(), &one, sizeof one);
    thread_.join();
    if (!socket_.empty()) ::unlink(socket_.c_str());
  }

  int port = 0;

 private:
  void Run();
  void Accept(int listener, bool check_host);
  // False: it is done.
  bool Serve(Connection& connection, short events);
  bool Read(Connection& connection);
  static bool Write(Connection& connection);

  const HttpPages pages_;
  const Descriptor port_listener_;
  const Descriptor socket_listener_;  // none: -1, which poll() passes over
  const fs::path socket_;
  const Descriptor stop_;
  std::list<Connection> connections_;  // the oldest first
  std::thread thread_;                 // the last: it uses all before it
};

void StatusServer::Impl::Run() {
  pthread_setname_np(pthread_self(), "status");
  while (true) {
    std::vector<pollfd> polled = {{stop_.number(), POLLIN, 0},
                                  {port_listener_.number(), POLLIN, 0},
                                  {socket_listener_.number(), POLLIN, 0}};
    const std::size_t first = polled.size();
    for (const Connection& each : connections_) {
      polled.push_back(
          {each.socket.number(), static_cast<short>(each.answer.empty() ? POLLIN : POLLOUT), 0});
    }
    int wait_ms = -1;
    if (!connections_.empty()) {
      const auto left = connections_.front().until - Clock::now();
      wait_ms = static_cast<int>(std::clamp<std::int64_t>(
          std::chrono::ceil<std::chrono::milliseconds>(left).count(), 0, 10'000));
    }
    if (::poll(polled.data(), polled.size(), wait_ms) < 0 && errno != EINTR) return;
    if (polled[0].revents != 0) return;
    std::size_t i = first;
    const auto now = Clock::now();
    for (auto it = connections_.begin(); it != connections_.end(); ++i) {
      const short events = polled[i].revents;
      const bool stays = events != 0 ? Serve(*it, events) : now < it->until;
      it = stays ? std::next(it) : connections_.erase(it);
    }
    if (polled[1].revents != 0) Accept(port_listener_.number(), true);
    if (polled[2].revents != 0) Accept(socket_listener_.number(), false);
  }
}

void StatusServer::Impl::Accept(int listener, bool check_host) {
  Descriptor socket(::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
  if (socket.number() < 0) return;
  if (connections_.size() >= kMostConnections) {
    auto idle = std::find_if(connections_.begin(), connections_.end(),
                             [](const Connection& each) { return each.request.empty(); });
    connections_.erase(idle == connections_.end() ? connections_.begin() : idle);
  }
  Connection& connection = connections_.emplace_back();
  connection.socket = std::move(socket);
  connection.check_host = check_host;
  connection.until = Clock::now() + kPatience;
}

bool StatusServer::Impl::Serve(Connection& connection, short events) {
  if ((events & (POLLERR | POLLNVAL)) != 0) return false;
  if (connection.answer.empty() && !Read(connection)) return false;
  return connection.answer.empty() || Write(connection);
}

bool StatusServer::Impl::Read(Connection& connection) {
  std::array<char, 2048> block{};
  const ssize_t size = ::recv(connection.socket.number(), block.data(), block.size(), 0);
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  if (size == 0) return false;
  connection.request.append(block.data(), static_cast<std::size_t>(size));
  if (IsWholeRequest(connection.request)) {
    connection.answer = AnswerTo(connection.request, pages_, connection.check_host);
    connection.until = Clock::now() + kPatience;
    return true;
  }
  return connection.request.size() < kMostRequestBytes;
}

bool StatusServer::Impl::Write(Connection& connection) {
  const ssize_t size =
      ::send(connection.socket.number(), connection.answer.data() + connection.sent,
             connection.answer.size() - connection.sent, MSG_NOSIGNAL);
  if (size < 0) return errno == EAGAIN || errno == EINTR;
  connection.sent += static_cast<std::size_t>(size);
  if (connection.sent < connection.answer.size()) return true;
  ::shutdown(connection.socket.number(), SHUT_WR);
  return false;
}

StatusServer::StatusServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StatusServer::~StatusServer() = default;
std::uint16_t StatusServer::port() const { return static_cast<std::uint16_t>(impl_->port); }

hal::Result<std::unique_ptr<StatusServer>> StatusServer::Start(std::uint16_t port,
                                                               const fs::path& socket,
                                                               Pages pages) {
  auto port_listener = ListenOnPort(port);
  if (!port_listener) return hal::Fail(port_listener.error());
  Descriptor socket_listener;
  if (!socket.empty()) {
    auto opened = ListenOnSocket(socket);
    if (!opened) return hal::Fail(opened.error());
    socket_listener = std::move(*opened);
  }
  auto impl = std::make_unique<Impl>(std::move(pages), std::move(*port_listener),
                                     std::move(socket_listener), socket);
  impl->port = port;
  return std::unique_ptr<StatusServer>(new StatusServer(std::move(impl)));
}

}  // namespace bendloop::host
