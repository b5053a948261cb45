// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_client.h"

#include <httplib.h>
#include <unistd.h>

#include <cerrno>

#include "firmware-host/console/whole_file.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostAnswerBytes = 16 << 20;

std::string Reason(httplib::Error error) {
  switch (error) {
    case httplib::Error::Connection:
    case httplib::Error::ConnectionTimeout:
      return "nobody listens there";
    case httplib::Error::Read:
      return "it fell silent, or speaks no HTTP";
    case httplib::Error::Canceled:
      return "it does not end";
    default:
      return httplib::to_string(error);
  }
}

hal::Result<std::string> Fetch(httplib::Client& client, const std::string& where,
                               const std::string& path, int timeout_s) {
  client.set_connection_timeout(timeout_s);
  client.set_read_timeout(timeout_s);
  client.set_write_timeout(timeout_s);
  std::string body;
  // For a socket the library would give its path as Host.
  const auto answer =
      client.Get(path, {{"Host", "localhost"}}, [&body](const char* data, std::size_t size) {
        body.append(data, size);
        return body.size() <= kMostAnswerBytes;
      });
  std::string why;
  if (!answer) {
    why = Reason(answer.error());
  } else if (answer->status != 200) {
    why = "it says " + std::to_string(answer->status) + " " + answer->reason;
  } else {
    return body;
  }
  return hal::Fail(hal::ErrorKind::kDevice, where + path + ": no answer, " + why);
}

hal::Result<std::string> FetchFromSocket(const fs::path& file, const std::string& path,
                                         int timeout_s) {
  constexpr int kAnyPort = 80;  // a socket has none; without one the path would be read as a URL
  httplib::Client client(file.string(), kAnyPort);
  client.set_address_family(AF_UNIX);
  return Fetch(client, file.string() + ":", path, timeout_s);
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
  httplib::Client client("127.0.0.1", port);
  return Fetch(client, "127.0.0.1:" + std::to_string(port), path, timeout_s);
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
