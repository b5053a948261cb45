// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/http_answer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string Ask(const std::string& request, bool check_host = true) {
  const HttpPages pages = {{"/status", {"application/json", [] { return std::string("{}"); }}}};
  return AnswerTo(request, pages, check_host);
}

TEST(HttpAnswer, AnswersThisMachineByItsNames) {
  for (const char* host : {"127.0.0.1:7480", "localhost", "LOCALHOST:1", "[::1]:7480", "[::1]"}) {
    const auto answer = Ask(std::string("GET /status HTTP/1.1\r\nHost: ") + host + "\r\n\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 OK\r\n")) << host;
    EXPECT_THAT(answer, HasSubstr("\r\nContent-Length: 2\r\n"));
    EXPECT_THAT(answer, EndsWith("\r\n\r\n{}"));
  }
  EXPECT_THAT(Ask("GET /status?pretty=1 HTTP/1.0\r\n\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(Ask("HEAD /status HTTP/1.1\r\n\r\n"), EndsWith("\r\n\r\n"));
}

TEST(HttpAnswer, RefusesAWebPageThatHasItsNameResolvedToUs) {
  const std::string request =
      "GET /status HTTP/1.1\r\nAccept: */*\r\nhOST: evil.example:7480\r\n\r\n";
  EXPECT_THAT(Ask(request), StartsWith("HTTP/1.1 403 "));
  EXPECT_THAT(Ask(request, false), StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(Ask("GET /status HTTP/1.1\r\nHost: 127.0.0.1.evil.example\r\n\r\n"),
              StartsWith("HTTP/1.1 403 "));
}

TEST(HttpAnswer, RefusesTheRestAndSaysWhatItExpected) {
  EXPECT_THAT(Ask("POST /status HTTP/1.1\r\n\r\n"), StartsWith("HTTP/1.1 405 "));
  EXPECT_THAT(Ask("GET / HTTP/1.1\r\n\r\n"), HasSubstr("expected one of /status"));
  for (const char* request : {"\r\n\r\n", "GET\r\n\r\n", "GET /status\r\n\r\n",
                              "GET /status SMTP\n\n", " \n\n", "\n\n"}) {
    EXPECT_THAT(Ask(request), StartsWith("HTTP/1.1 400 ")) << request;
  }
}

TEST(HttpAnswer, WaitsForTheEmptyLine) {
  EXPECT_FALSE(IsWholeRequest("GET / HTTP/1.1\r\nHost: a\r\n"));
  EXPECT_TRUE(IsWholeRequest("GET / HTTP/1.1\r\nHost: a\r\n\r\n"));
}

}  // namespace
}  // namespace bendloop::host
