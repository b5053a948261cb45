// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_server.h"

#include <arpa/inet.h>
#include <microhttpd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <map>
#include <new>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "firmware-host/daemon/doorkeeper.h"
#include "firmware-host/workers/want_of_memory.h"
#include "hal/text.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// Of each daemon of libmicrohttpd.
constexpr unsigned kMostConnections = 256;
constexpr unsigned kPatience_s = 2;  // without a byte from or to a client
// With a client as a whole: a head and an answer go through a socket at once.
constexpr std::chrono::seconds kWholePatience(5);
// Of a connection, for the head of its request and of its answer: twice what a browser may say.
constexpr std::size_t kConnectionBytes = 16 << 10;
constexpr int kBacklog = 64;

hal::Error ServerError(const std::string& where, const std::string& why) {
  return {hal::ErrorKind::kDevice, "status server: " + where + ": " + why};
}

std::string ErrorText(int error_number) { return std::generic_category().message(error_number); }

// A listening descriptor, for the group that the directory belongs to, which may read what stands
// in it.
hal::Result<int> ListenOnSocket(const fs::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.string().size() >= sizeof address.sun_path) {
    return hal::Fail(ServerError(path.string(), "longer than a socket's name may be, " +
                                                    std::to_string(sizeof address.sun_path - 1) +
                                                    "; set a shorter state_dir"));
  }
  std::memcpy(address.sun_path, path.c_str(), path.string().size() + 1);
  ::unlink(path.c_str());  // of a daemon that was killed: the state directory is ours by its lock
  const int listener = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  struct stat directory {};
  if (listener >= 0 &&
      ::bind(listener, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0 &&
      ::stat(path.parent_path().c_str(), &directory) == 0 && ::chmod(path.c_str(), 0660) == 0 &&
      // Not ours to give away to that group: then our own is asked for.
      (::chown(path.c_str(), static_cast<uid_t>(-1), directory.st_gid) == 0 || errno == EPERM) &&
      ::listen(listener, kBacklog) == 0) {
    return listener;
  }
  const int why = errno;
  if (listener >= 0) ::close(listener);
  return hal::Fail(ServerError(path.string(), ErrorText(why)));
}

bool SomebodyListens(const sockaddr_in& address) {
  const int caller = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool is_answered =
      caller < 0 ||
      ::connect(caller, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  if (caller >= 0) ::close(caller);
  return is_answered;
}

MHD_Result Answer(MHD_Connection* connection, unsigned status, const char* type,
                  const std::string& body) {
  // The library copies it and does not write to it.
  MHD_Response* const response = MHD_create_response_from_buffer(
      body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, type);
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
  MHD_add_response_header(response, MHD_HTTP_HEADER_CACHE_CONTROL, "no-store");
  MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
  if (status == MHD_HTTP_METHOD_NOT_ALLOWED) {
    MHD_add_response_header(response, MHD_HTTP_HEADER_ALLOW, "GET, HEAD");
  }
  const MHD_Result queued = MHD_queue_response(connection, status, response);
  MHD_destroy_response(response);
  return queued;
}

// Where there is no memory for the answer: the library needs a few hundred bytes for this one, and
// may not have them.
MHD_Result SayOutOfMemory(MHD_Connection* connection) noexcept {
  static char text[] = "out of memory; ask again\n";
  MHD_Response* const response =
      MHD_create_response_from_buffer(sizeof text - 1, text, MHD_RESPMEM_PERSISTENT);
  if (response == nullptr) return MHD_NO;
  const MHD_Result queued = MHD_queue_response(connection, MHD_HTTP_SERVICE_UNAVAILABLE, response);
  MHD_destroy_response(response);
  return queued;
}

MHD_Result Refuse(MHD_Connection* connection, unsigned status, const std::string& why) {
  return Answer(connection, status, "text/plain", why + "\n");
}

// The values of Host in a request.
std::vector<std::string> HostsOf(MHD_Connection* connection) {
  struct Found {
    std::vector<std::string> hosts;
    bool has_memory = true;
  } found;
  // No exception may cross the library.
  const auto take = [](void* to, MHD_ValueKind, const char* key, const char* value) {
    auto& all = *static_cast<Found*>(to);
    all.has_memory &= HasMemoryFor([&] {
      if (hal::Lower(key) == "host") all.hosts.emplace_back(value ? value : "");
    });
    return all.has_memory ? MHD_YES : MHD_NO;
  };
  MHD_get_connection_values(connection, MHD_HEADER_KIND, take, &found);
  if (!found.has_memory) throw std::bad_alloc();
  return std::move(found.hosts);
}

// Whether Host is a name of this machine's own, with any port: who comes through a tunnel has
// another one. A web page elsewhere that has a browser resolve its name to 127.0.0.1 (DNS
// rebinding) still says its own name there.
bool IsThisMachine(std::string_view said) {
  std::string host = hal::Lower(hal::Trimmed(said));
  const std::size_t colon = host.rfind(':');
  if (colon != std::string::npos && host.find(']', colon) == std::string::npos) host.erase(colon);
  return host == "127.0.0.1" || host == "localhost" || host == "[::1]";
}

}  // namespace

class StatusServer::Impl {
 public:
  explicit Impl(Pages pages)
      : pages_{{"/status", {"application/json", std::move(pages.status)}},
               {"/metrics", {"text/plain; version=0.0.4", std::move(pages.metrics)}}},
        out_of_memory_(std::move(pages.out_of_memory)) {}

  ~Impl() {
    on_port_.reset();
    on_socket_.reset();
    if (!socket_.empty()) ::unlink(socket_.c_str());
  }

  hal::Result<void> StartOnPort(std::uint16_t port);
  hal::Result<void> StartOnSocket(const fs::path& socket);
  std::uint16_t port() const {
    return MHD_get_daemon_info(on_port_.get(), MHD_DAEMON_INFO_BIND_PORT)->port;
  }

 private:
  struct PageText {
    const char* type;
    std::function<std::string()> text;
  };
  struct Stop {
    void operator()(MHD_Daemon* daemon) const { MHD_stop_daemon(daemon); }
  };
  using Daemon = std::unique_ptr<MHD_Daemon, Stop>;

  Daemon Start(MHD_AccessHandlerCallback answer, MHD_OptionItem where,
               MHD_OptionItem how = {MHD_OPTION_END, 0, nullptr}) {
    MHD_OptionItem listen[] = {where, how, {MHD_OPTION_END, 0, nullptr}};
    // Without MHD_USE_ERROR_LOG: what a client does wrong is the client's to know.
    return Daemon(MHD_start_daemon(
        MHD_USE_POLL_INTERNAL_THREAD | MHD_USE_ITC, 0, nullptr, nullptr, answer, this,
        MHD_OPTION_CONNECTION_LIMIT, kMostConnections, MHD_OPTION_CONNECTION_TIMEOUT, kPatience_s,
        MHD_OPTION_CONNECTION_MEMORY_LIMIT, kConnectionBytes, MHD_OPTION_NOTIFY_CONNECTION,
        Doorkeeper::Note, &doorkeeper_, MHD_OPTION_ARRAY, listen, MHD_OPTION_END));
  }

  // Called as soon as the head of a request is there, and answers at once: a body is not read.
  static MHD_Result OnPort(void* self, MHD_Connection* connection, const char* path,
                           const char* method, const char* /*version*/, const char* /*body*/,
                           std::size_t* /*body_size*/, void** /*state*/) {
    const auto& server = *static_cast<const Impl*>(self);
    return server.InMemory(connection, [&] {
      const auto hosts = HostsOf(connection);
      if (hosts.size() != 1) {  // which one counts, servers disagree on
        return Refuse(connection, MHD_HTTP_BAD_REQUEST, "expected one Host");
      }
      if (!IsThisMachine(hosts.front())) {
        return Refuse(connection, MHD_HTTP_FORBIDDEN, "expected Host 127.0.0.1 or localhost");
      }
      return server.Page(connection, path, method);
    });
  }
  static MHD_Result OnSocket(void* self, MHD_Connection* connection, const char* path,
                             const char* method, const char* /*version*/, const char* /*body*/,
                             std::size_t* /*body_size*/, void** /*state*/) {
    const auto& server = *static_cast<const Impl*>(self);
    return server.InMemory(connection, [&] { return server.Page(connection, path, method); });
  }
  MHD_Result Page(MHD_Connection* connection, const char* path, const char* method) const;
  // What `answer` queues, or that there was no memory for it.
  template <class Answer>
  MHD_Result InMemory(MHD_Connection* connection, Answer&& answer) const {
    MHD_Result queued = MHD_NO;
    if (HasMemoryFor([&] { queued = answer(); })) return queued;
    if (out_of_memory_) out_of_memory_();
    return SayOutOfMemory(connection);
  }

  const std::map<std::string, PageText, std::less<>> pages_;  // by path
  const std::function<void()> out_of_memory_;
  fs::path socket_;
  Doorkeeper doorkeeper_{kWholePatience};  // outlives both, which tell it of their last connections
  Daemon on_port_;
  Daemon on_socket_;
};

MHD_Result StatusServer::Impl::Page(MHD_Connection* connection, const char* path,
                                    const char* method) const {
  const std::string_view verb = method;
  if (verb != MHD_HTTP_METHOD_GET && verb != MHD_HTTP_METHOD_HEAD) {
    return Refuse(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "expected GET or HEAD");
  }
  const auto page = pages_.find(std::string_view(path));
  if (page == pages_.end()) {
    std::string known;
    for (const auto& [each, unused] : pages_) known += " " + each;
    return Refuse(connection, MHD_HTTP_NOT_FOUND, "expected one of" + known);
  }
  return Answer(connection, MHD_HTTP_OK, page->second.type, page->second.text());
}

hal::Result<void> StatusServer::Impl::StartOnPort(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  errno = 0;
  const MHD_OptionItem here = {MHD_OPTION_SOCK_ADDR, 0, &address};
  on_port_ = Start(OnPort, here);
  // The closed connections of a predecessor that shared its port (SO_REUSEPORT alone, as version
  // 0.1.0 did) keep it for a minute from who does not share it too. One that listens keeps it.
  if (!on_port_ && errno == EADDRINUSE) {
    if (!SomebodyListens(address)) {
      on_port_ = Start(OnPort, here, {MHD_OPTION_LISTENING_ADDRESS_REUSE, 1, nullptr});
    } else {
      errno = EADDRINUSE;
    }
  }
  if (on_port_) return {};
  return hal::Fail(ServerError("127.0.0.1:" + std::to_string(port),
                               ErrorText(errno) + "; give it another port"));
}

hal::Result<void> StatusServer::Impl::StartOnSocket(const fs::path& socket) {
  const auto listener = ListenOnSocket(socket);
  if (!listener) return hal::Fail(listener.error());
  socket_ = socket;
  errno = 0;
  on_socket_ = Start(OnSocket, {MHD_OPTION_LISTEN_SOCKET, *listener, nullptr});  // which closes it
  if (on_socket_) return {};
  return hal::Fail(ServerError(socket.string(), ErrorText(errno)));
}

StatusServer::StatusServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StatusServer::~StatusServer() = default;
std::uint16_t StatusServer::port() const { return impl_->port(); }

hal::Result<std::unique_ptr<StatusServer>> StatusServer::Start(std::uint16_t port,
                                                               const fs::path& socket,
                                                               Pages pages) {
  auto impl = std::make_unique<Impl>(std::move(pages));
  if (const auto started = impl->StartOnPort(port); !started) return hal::Fail(started.error());
  if (!socket.empty()) {
    if (const auto started = impl->StartOnSocket(socket); !started) {
      return hal::Fail(started.error());
    }
  }
  return std::unique_ptr<StatusServer>(new StatusServer(std::move(impl)));
}

}  // namespace bendloop::host
