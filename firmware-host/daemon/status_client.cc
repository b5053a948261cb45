// SPDX-License-Identifier: Apache-2.0
// The other end of the status server: what `bendloop status` and the demo ask with.
#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "firmware-host/daemon/state_store.h"
#include "firmware-host/daemon/status_server.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostAnswerBytes = 16 << 20;

std::string Reason(int error_number) { return std::generic_category().message(error_number); }

// Asks over a socket that is connected by `connect`, and closes it.
template <class Connect>
hal::Result<std::string> Fetch(int socket, const Connect& connect, const std::string& where,
                               const std::string& path, int timeout_s) {
  const auto fail = [&](const std::string& why) {
    if (socket >= 0) ::close(socket);
    return hal::Fail(hal::ErrorKind::kDevice, where + path + ": no answer, " + why);
  };
  const timeval timeout{timeout_s, 0};
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  ::setsockopt(socket, SOL_SOCKET, SO_SNDTIMEO, &timeout, sizeof timeout);
  if (socket < 0 || connect(socket) != 0) return fail(Reason(errno));
  const std::string request = "GET " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
  if (::send(socket, request.data(), request.size(), MSG_NOSIGNAL) !=
      static_cast<ssize_t>(request.size())) {
    return fail(Reason(errno));
  }
  std::string answer;
  std::array<char, 16384> block{};
  ssize_t size = 0;
  while ((size = ::recv(socket, block.data(), block.size(), 0)) > 0) {
    answer.append(block.data(), static_cast<std::size_t>(size));
    if (answer.size() > kMostAnswerBytes) return fail("it does not end");
  }
  if (size < 0) return fail(Reason(errno));
  const std::size_t head = answer.find("\r\n\r\n");
  if (head == std::string::npos) return fail("no HTTP");
  if (answer.compare(0, 13, "HTTP/1.1 200 ") != 0) {
    return fail("it says " + answer.substr(0, answer.find('\r')));
  }
  ::close(socket);
  return answer.substr(head + 4);
}

hal::Result<std::string> FetchFromSocket(const fs::path& file, const std::string& path,
                                         int timeout_s) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, file.c_str(), sizeof address.sun_path - 1);
  return Fetch(
      ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0),
      [&](int socket) {
        return ::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address);
      },
      file.string() + ":", path, timeout_s);
}

hal::Result<Json> StatusIn(const hal::Result<std::string>& body) {
  if (!body) return hal::Fail(body.error());
  Json status = Json::parse(*body, nullptr, false);
  if (!status.is_object()) {
    return hal::Fail(hal::ErrorKind::kDevice, "the answer is no JSON object");
  }
  return status;
}

}  // namespace

hal::Result<std::string> FetchLocal(std::uint16_t port, const std::string& path, int timeout_s) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  address.sin_port = htons(port);
  return Fetch(
      ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0),
      [&](int socket) {
        return ::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address);
      },
      "127.0.0.1:" + std::to_string(port), path, timeout_s);
}

hal::Result<Json> FetchStatus(std::uint16_t port) {
  auto status = StatusIn(FetchLocal(port, "/status"));
  if (status) return status;
  return hal::Fail(hal::ErrorKind::kDevice, "no daemon answers (" + status.error().message +
                                                "); start bendloopd, or name its port");
}

hal::Result<Json> FetchStatus(const fs::path& address_file) {
  const fs::path directory = address_file.parent_path();
  const auto no_daemon = [&](const std::string& why) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     directory.string() + ": no daemon answers (" + why +
                         "); start bendloopd, or name its --state-dir or --config");
  };
  if (::access(address_file.c_str(), R_OK) != 0 && errno == EACCES) {
    return hal::Fail(
        hal::ErrorKind::kDevice,
        directory.string() +
            ": may not be read by this user, so nobody knows whether a daemon runs; ask "
            "as root or as a member of its group (bendloop), or ask its port: --port "
            "7480");
  }
  const auto text = ReadWholeFile(address_file, 4096);
  if (!text) return no_daemon("no " + address_file.filename().string());
  const Json address = Json::parse(*text, nullptr, false);
  if (!address.is_object() || !address.contains("port") || !address["port"].is_number_unsigned() ||
      address["port"] > 65535u) {
    return no_daemon("no port in " + address_file.filename().string());
  }
  if (address.contains("socket") && address["socket"].is_string()) {
    const fs::path socket = directory / address["socket"].get<std::string>();
    if (auto status = StatusIn(FetchFromSocket(socket, "/status", 2))) return status;
  }
  auto status = StatusIn(FetchLocal(address["port"].get<std::uint16_t>(), "/status"));
  if (!status) return no_daemon(status.error().message);
  return status;
}

}  // namespace bendloop::host
