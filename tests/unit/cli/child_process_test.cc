// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/demo/child_process.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace bendloop::host {
namespace {

using ::testing::HasSubstr;
using namespace std::chrono_literals;

hal::Result<ChildProcess> Shell(const std::string& script) {
  return ChildProcess::Start("/bin/sh", {"-c", script}, "/dev/null");
}

TEST(ChildProcess, TalksInLines) {
  auto child = Shell("echo listening 4711; read line; echo \"bent $line\"");
  ASSERT_TRUE(child) << child.error().message;
  EXPECT_EQ(child->Expect("listening", 20s).value_or(""), "4711");
  ASSERT_TRUE(child->WriteLine("part-0001.json"));
  EXPECT_EQ(child->Expect("bent", 20s).value_or(""), "part-0001.json");
}

TEST(ChildProcess, SaysWhenItEndsTooEarlyOrComplains) {
  auto gone = Shell("exit 3");
  ASSERT_TRUE(gone);
  const auto nothing = gone->Expect("listening", 20s);
  ASSERT_FALSE(nothing);
  EXPECT_THAT(nothing.error().message, HasSubstr("ended before it said 'listening'"));
  auto complains = Shell("echo error the press is jammed; read line");
  ASSERT_TRUE(complains);
  const auto jammed = complains->Expect("bent", 20s);
  ASSERT_FALSE(jammed);
  EXPECT_THAT(jammed.error().message, HasSubstr("jammed"));
}

TEST(ChildProcess, GivesUpOnSilence) {
  auto child = Shell("read line");
  ASSERT_TRUE(child);
  const auto silent = child->Expect("listening", 20ms);
  ASSERT_FALSE(silent);
  EXPECT_THAT(silent.error().message, HasSubstr("within 20 ms"));
}

TEST(ChildProcess, EndsWithItsInputAndElseIsKilled) {
  auto polite = Shell("read line; exit 7");
  ASSERT_TRUE(polite);
  polite->Stop(20s);
  auto stubborn = Shell("trap '' TERM; echo ready now; while :; do read line || sleep 1; done");
  ASSERT_TRUE(stubborn);
  ASSERT_TRUE(stubborn->Expect("ready", 20s));
  EXPECT_EQ(stubborn->Stop(10ms), 128 + 9);
}

TEST(ChildProcess, AProgramThatIsNotThereIsADeviceError) {
  const auto child = ChildProcess::Start("/does/not/exist", {}, "/dev/null");
  ASSERT_FALSE(child);
  EXPECT_EQ(child.error().kind, hal::ErrorKind::kDevice);
  EXPECT_THAT(child.error().message, HasSubstr("/does/not/exist"));
}

}  // namespace
}  // namespace bendloop::host
