// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "firmware-host/daemon/status_client.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class StatusServerTest : public ::testing::Test {
 protected:
  StatusServerTest() {
    std::string name = (fs::temp_directory_path() / "bendloop-XXXXXX").string();
    directory_ = mkdtemp(name.data());
    auto started = StatusServer::Start(0, directory_ / "status.sock",
                                       {[] { return std::string("{\"state\": \"idle\"}"); },
                                        [] { return std::string("bendloop_up 1\n"); }});
    EXPECT_TRUE(started) << started.error().message;
    server_ = std::move(*started);
  }
  ~StatusServerTest() override {
    server_.reset();
    fs::remove_all(directory_);
  }
  // A client that connects and says nothing.
  int Idle() const {
    const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(server_->port());
    EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    return socket;
  }
  // What the server says to a request for `path` that names this Host.
  httplib::Result Ask(const std::string& path, const std::string& host) const {
    return httplib::Client("127.0.0.1", server_->port()).Get(path, {{"Host", host}});
  }
  void WriteAddress(const std::string& text) const {
    std::ofstream(directory_ / "status.json") << text;
  }
  fs::path directory_;
  std::unique_ptr<StatusServer> server_;
};

TEST_F(StatusServerTest, AnswersOnPortAndSocket) {
  EXPECT_EQ(FetchLocal(server_->port(), "/metrics").value(), "bendloop_up 1\n");
  EXPECT_EQ(FetchStatus(server_->port()).value().at("state"), "idle");
  EXPECT_THAT(FetchLocal(server_->port(), "/else").error().message, HasSubstr("404"));
  // The port is another's: only the socket can have answered.
  WriteAddress(R"({"port": 1, "socket": "status.sock"})");
  const auto status = FetchStatus(directory_ / "status.json");
  ASSERT_TRUE(status) << status.error().message;
  struct stat socket {};
  ASSERT_EQ(stat((directory_ / "status.sock").c_str(), &socket), 0);
  EXPECT_EQ(socket.st_mode & 0777, 0660u);
  server_.reset();
  EXPECT_FALSE(fs::exists(directory_ / "status.sock"));
  EXPECT_FALSE(FetchStatus(directory_ / "status.json"));
}

TEST_F(StatusServerTest, AnswersThisMachineByItsNames) {
  for (const char* host : {"127.0.0.1:7480", "localhost", "LOCALHOST:1", "[::1]:7480", "[::1]"}) {
    const auto answer = Ask("/status?pretty=1", host);
    ASSERT_TRUE(answer) << host;
    EXPECT_EQ(answer->status, 200) << host;
    EXPECT_EQ(answer->body, "{\"state\": \"idle\"}");
    EXPECT_EQ(answer->get_header_value("Content-Type"), "application/json");
    EXPECT_EQ(answer->get_header_value("Cache-Control"), "no-store");
    EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff");
  }
}

TEST_F(StatusServerTest, RefusesAWebPageThatHasItsNameResolvedToUs) {
  for (const char* host :
       {"evil.example:7480", "127.0.0.1.evil.example", "[::1].evil.example", ""}) {
    const auto answer = Ask("/status", host);
    ASSERT_TRUE(answer) << host;
    EXPECT_EQ(answer->status, 403) << host;
    EXPECT_THAT(answer->body, HasSubstr("expected Host"));
  }
  // No web page gets at the socket.
  httplib::Client client((directory_ / "status.sock").string(), 80);
  client.set_address_family(AF_UNIX);
  const auto answer = client.Get("/metrics", {{"Host", "evil.example"}});
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  EXPECT_EQ(answer->body, "bendloop_up 1\n");
}

TEST_F(StatusServerTest, RefusesTheRestAndSaysWhatItExpected) {
  httplib::Client client("127.0.0.1", server_->port());
  const auto head = client.Head("/status");
  ASSERT_TRUE(head);
  EXPECT_EQ(head->status, 200);
  EXPECT_EQ(head->get_header_value("Content-Length"), "17");
  EXPECT_EQ(head->body, "");
  const auto post = client.Post("/status", "a body", "text/plain");
  ASSERT_TRUE(post);
  EXPECT_EQ(post->status, 405);
  EXPECT_EQ(post->get_header_value("Allow"), "GET, HEAD");
  const auto root = client.Get("/");
  ASSERT_TRUE(root);
  EXPECT_EQ(root->status, 404);
  EXPECT_EQ(root->body, "expected one of /metrics /status\n");
}

TEST_F(StatusServerTest, SaysThatThePortIsTaken) {
  const auto second = StatusServer::Start(server_->port(), "", {});
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("Address already in use; give it another port"));
}

TEST_F(StatusServerTest, ClosedConnectionsOfAPredecessorDoNotKeepThePort) {
  // As version 0.1.0 listened: the port is shared, and who has answered closes first.
  const int listener = ::socket(AF_INET, SOCK_STREAM, 0);
  const int yes = 1;
  ASSERT_EQ(::setsockopt(listener, SOL_SOCKET, SO_REUSEPORT, &yes, sizeof yes), 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* const where = reinterpret_cast<sockaddr*>(&address);
  socklen_t size = sizeof address;
  ASSERT_EQ(::bind(listener, where, size), 0);
  ASSERT_EQ(::listen(listener, 1), 0);
  ASSERT_EQ(::getsockname(listener, where, &size), 0);
  const int client = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_EQ(::connect(client, where, size), 0);
  const int served = ::accept(listener, nullptr, nullptr);
  ::close(served);
  char none = 0;
  ASSERT_EQ(::read(client, &none, 1), 0);
  ::close(client);
  ::close(listener);
  const auto next = StatusServer::Start(ntohs(address.sin_port), "", {});
  EXPECT_TRUE(next) << next.error().message;
}

TEST_F(StatusServerTest, IdleConnectionsKeepNobodyOut) {
  std::vector<int> idle;
  for (int i = 0; i < 200; ++i) idle.push_back(Idle());
  for (int i = 0; i < 3; ++i) {
    const auto body = FetchLocal(server_->port(), "/status");
    EXPECT_TRUE(body) << body.error().message;
  }
  for (const int socket : idle) close(socket);
}

TEST_F(StatusServerTest, WhoComesWhenAllAreTakenWaitsUntilAnIdleOneIsClosed) {
  std::vector<int> idle;
  for (int i = 0; i < 300; ++i) idle.push_back(Idle());
  constexpr int kLonger_s = 20;  // than the patience with them
  const auto body = FetchLocal(server_->port(), "/status", kLonger_s);
  EXPECT_TRUE(body) << body.error().message;
  for (const int socket : idle) close(socket);
}

TEST_F(StatusServerTest, AnIdleConnectionIsClosed) {
  const int socket = Idle();
  char byte = 0;
  EXPECT_LE(recv(socket, &byte, 1, 0), 0);  // waits for the end
  close(socket);
}

TEST_F(StatusServerTest, WhoSendsAByteNowAndThenIsSentAwayAsWell) {
  const int socket = Idle();
  const std::string begun = "GET /status HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ";
  EXPECT_GT(send(socket, begun.data(), begun.size(), MSG_NOSIGNAL), 0);
  constexpr int kEach_ms = 200, kMost = 100;
  int sent = 0;
  for (pollfd closed{socket, POLLIN, 0}; sent < kMost && poll(&closed, 1, kEach_ms) == 0; ++sent) {
    (void)send(socket, "x", 1, MSG_NOSIGNAL);
  }
  EXPECT_LT(sent, kMost);
  close(socket);
}

// A whole request as it stands, and the first line of the answer.
std::string Said(int socket, const std::string& request) {
  EXPECT_EQ(send(socket, request.data(), request.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(request.size()));
  char answer[200] = {};
  EXPECT_GT(recv(socket, answer, sizeof answer - 1, 0), 0);
  close(socket);
  return std::string(answer).substr(0, std::string(answer).find('\r'));
}

TEST_F(StatusServerTest, RefusesARequestThatNamesNoHostOrTwo) {
  EXPECT_THAT(Said(Idle(), "GET /status HTTP/1.1\r\n\r\n"), HasSubstr(" 400 "));
  EXPECT_THAT(Said(Idle(), "GET /status HTTP/1.0\r\n\r\n"), HasSubstr(" 400 "));
  EXPECT_THAT(Said(Idle(), "GET /status HTTP/1.1\r\nHost: localhost\r\nhost: evil\r\n\r\n"),
              HasSubstr(" 400 "));
  EXPECT_THAT(Said(Idle(), "GET /status HTTP/1.1\r\nhost: localhost\r\n\r\n"), HasSubstr(" 200 "));
}

TEST_F(StatusServerTest, SaysSoWhenTheUserMayNotKnow) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to become somebody else";
  WriteAddress(R"({"port": 1, "socket": "status.sock"})");
  ASSERT_EQ(chmod(directory_.c_str(), 0700), 0);
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  if (child == 0) {
    constexpr uid_t kNobody = 65534;
    if (setuid(kNobody) != 0) _exit(1);
    const auto status = FetchStatus(directory_ / "status.json");
    const std::string message = status ? "known" : status.error().message;
    _exit(write(ends[1], message.data(), message.size()) > 0 ? 0 : 1);
  }
  close(ends[1]);
  std::string message(1000, '\0');
  message.resize(
      static_cast<std::size_t>(std::max<ssize_t>(0, read(ends[0], message.data(), 1000))));
  close(ends[0]);
  waitpid(child, nullptr, 0);
  EXPECT_THAT(message, HasSubstr("may not be read by this user"));
  EXPECT_THAT(message, HasSubstr("--port"));
}

}  // namespace
}  // namespace bendloop::host
