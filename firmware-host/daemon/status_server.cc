// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_server.h"

#include <httplib.h>
#include <pthread.h>

#include <thread>
#include <utility>

#include "firmware-host/daemon/state_store.h"

namespace bendloop::host {

class StatusServer::Impl {
 public:
  httplib::Server server;
  int port = 0;
  std::thread thread;

  ~Impl() {
    server.stop();
    if (thread.joinable()) thread.join();
  }
};

StatusServer::StatusServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StatusServer::~StatusServer() = default;
std::uint16_t StatusServer::port() const { return static_cast<std::uint16_t>(impl_->port); }

hal::Result<std::unique_ptr<StatusServer>> StatusServer::Start(std::uint16_t port, Pages pages) {
  auto impl = std::make_unique<Impl>();
  httplib::Server& server = impl->server;
  // Two workers: a client that keeps its connection open must not shut the next one out.
  server.new_task_queue = [] { return new httplib::ThreadPool(2); };
  server.set_keep_alive_max_count(1);
  server.set_read_timeout(2);
  server.set_write_timeout(2);
  server.set_payload_max_length(4096);
  server.Get("/status", [page = pages.status](const httplib::Request&, httplib::Response& reply) {
    reply.set_content(page(), "application/json");
  });
  server.Get("/metrics", [page = pages.metrics](const httplib::Request&, httplib::Response& reply) {
    reply.set_content(page(), "text/plain; version=0.0.4");
  });
  if (port == 0) {
    impl->port = server.bind_to_any_port("127.0.0.1");
  } else {
    impl->port = server.bind_to_port("127.0.0.1", port) ? port : -1;
  }
  if (impl->port <= 0) {
    return hal::Fail(hal::ErrorKind::kDevice, "status server: 127.0.0.1:" + std::to_string(port) +
                                                  " is taken; give it another port");
  }
  impl->thread = std::thread([raw = impl.get()] {
    pthread_setname_np(pthread_self(), "status");
    raw->server.listen_after_bind();
  });
  // stop() does nothing to a server that does not listen yet.
  while (!server.is_running()) std::this_thread::yield();
  return std::unique_ptr<StatusServer>(new StatusServer(std::move(impl)));
}

hal::Result<std::string> FetchLocal(std::uint16_t port, const std::string& path, int timeout_s) {
  httplib::Client client("127.0.0.1", port);
  client.set_connection_timeout(timeout_s);
  client.set_read_timeout(timeout_s);
  const auto reply = client.Get(path);
  if (!reply || reply->status != 200) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     "127.0.0.1:" + std::to_string(port) + path + ": no answer" +
                         (reply ? ", status " + std::to_string(reply->status) : std::string()));
  }
  return reply->body;
}

hal::Result<Json> FetchStatus(const std::filesystem::path& address_file) {
  const auto no_daemon = [&](const std::string& why) {
    return hal::Fail(hal::ErrorKind::kDevice,
                     address_file.parent_path().string() + ": no daemon answers (" + why +
                         "); start bendloopd, or name its --state-dir or --config");
  };
  const auto text = ReadWholeFile(address_file, 4096);
  if (!text) return no_daemon("no " + address_file.filename().string());
  const Json address = Json::parse(*text, nullptr, false);
  if (!address.is_object() || !address.contains("port") || !address["port"].is_number_unsigned() ||
      address["port"] > 65535u) {
    return no_daemon("no port in " + address_file.filename().string());
  }
  const auto body = FetchLocal(address["port"].get<std::uint16_t>(), "/status");
  if (!body) return no_daemon(body.error().message);
  Json status = Json::parse(*body, nullptr, false);
  if (!status.is_object()) return no_daemon("the answer is no JSON object");
  return status;
}

}  // namespace bendloop::host
