// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/status_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

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

TEST_F(StatusServerTest, IdleConnectionsKeepNobodyOut) {
  std::vector<int> idle;
  for (int i = 0; i < 200; ++i) idle.push_back(Idle());
  for (int i = 0; i < 3; ++i) {
    const auto body = FetchLocal(server_->port(), "/status");
    EXPECT_TRUE(body) << body.error().message;
  }
  for (const int socket : idle) close(socket);
}

TEST_F(StatusServerTest, AnIdleConnectionIsClosed) {
  const int socket = Idle();
  char byte = 0;
  EXPECT_LE(recv(socket, &byte, 1, 0), 0);  // waits for the end
  close(socket);
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
