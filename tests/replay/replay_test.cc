// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "firmware-host/result/result_json.h"
#include "program.h"

namespace bendloop::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

// A cell with the shipped demo part and a simulated bender.
std::string WriteCell(const Scratch& scratch, const std::string& more = "") {
  const std::string path = (scratch / "cell.toml").string();
  std::ofstream(path) << "schema = \"bendloop.cell/1\"\nname = \"test\"\n"
                      << "part = \"" BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\n"
                      << "state_dir = \"state\"\n[scanner]\nkind = \"simulated\"\n"
                      << "[bender]\nlink = \"simulated\"\n"
                      << "register_map = \"" BENDLOOP_SOURCE_DIR
                         "/config/register-maps/default.toml\"\n"
                      << more;
  return path;
}

// Results are long: a failed matcher would print them whole.
bool Has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// The result without the one section that may differ.
std::string WithoutTiming(const std::string& json) {
  const std::size_t at = json.find("\"timing_ms\"");
  EXPECT_NE(at, std::string::npos);
  return json.substr(0, at);
}

std::string Simulate(const Scratch& scratch, const std::string& options,
                     const char* spacing_mm = "0.5") {
  const std::string session = (scratch / "scan.session").string();
  const Ran ran =
      scratch.Bendloop("simulate --part " BENDLOOP_SOURCE_DIR "/config/parts/demo.toml --out " +
                       session + " --spacing " + spacing_mm + " --rays 320 --views 2 " + options);
  EXPECT_EQ(ran.code, 0) << ran.err;
  return session;
}

TEST(Replay, TheSameBytesEveryTimeAtEveryPace) {
  const Scratch scratch;
  const std::string cell = WriteCell(scratch);
  const std::string session = Simulate(scratch, "--seed 3 --springback-120 4.6");
  std::string first;
  for (const char* pace : {"max", "max", "recorded"}) {
    const std::string json = (scratch / "result.json").string();
    const Ran ran = scratch.Bendloop("replay " + session + " --config " + cell + " --pace " + pace +
                                     " --json " + json);
    EXPECT_THAT(ran.code, ::testing::AnyOf(0, 1)) << ran.err;
    const std::string text = WithoutTiming(Slurp(json));
    EXPECT_TRUE(Has(text, "\"correction\""));
    EXPECT_TRUE(Has(text, "\"committed\""));
    if (first.empty()) first = text;
    EXPECT_TRUE(text == first) << pace;
  }
}

TEST(Replay, ARefusedPartIsOneWithItsReasonAndNothingIsSent) {
  const Scratch scratch;
  const std::string cell =
      WriteCell(scratch, "[interlocks]\nmin_coverage = 0.999\nmax_fit_rms_mm = 0.001\n");
  const std::string session = Simulate(scratch, "--seed 4");
  const std::string json = (scratch / "result.json").string();
  const Ran ran = scratch.Bendloop("replay " + session + " --config " + cell + " --json " + json);
  EXPECT_EQ(ran.code, 1) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("bendloop: "));
  const std::string text = Slurp(json);
  EXPECT_TRUE(Has(text, "\"interlocks\""));
  const auto result = host::ReadResultJson(text, json);
  ASSERT_TRUE(result && result->bender);  // the reader of the JSON sees why nothing was sent
  EXPECT_EQ(result->bender->outcome, host::CommitOutcome::kRefused);
  EXPECT_THAT(result->bender->reason, HasSubstr("nothing was sent: "));
  EXPECT_TRUE(result->bender->active);
}

TEST(Replay, WhatIsUndecidedIsSaidThoughItIsNoFailure) {
  const Scratch scratch;
  // So far apart that the first straight is known to half of its tolerance.
  const Ran ran =
      scratch.Bendloop("replay " + Simulate(scratch, "", "3") + " --config " + WriteCell(scratch));
  EXPECT_THAT(ran.out, HasSubstr("UNDECIDED"));
  EXPECT_EQ(ran.code, 0);
  EXPECT_THAT(ran.err, HasSubstr("too close to the tolerance to decide"));
}

TEST(Replay, AJsonOnStandardOutputIsAlone) {
  const Scratch scratch;
  const std::string cell = WriteCell(scratch);
  const Ran ran = scratch.Bendloop("replay " + Simulate(scratch, "--seed 5") + " --config " + cell +
                                   " --json -");
  EXPECT_TRUE(host::ReadResultJson(ran.out, "stdout").has_value()) << ran.out.substr(0, 200);
}

TEST(Replay, ASessionWithoutAScanIsBadInput) {
  const Scratch scratch;
  const std::string cell = WriteCell(scratch, "[scan]\nmin_profiles = 100000\n");
  const Ran ran = scratch.Bendloop("replay " + Simulate(scratch, "") + " --config " + cell);
  EXPECT_EQ(ran.code, 3) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("expected at least 100000"));
}

TEST(Replay, ABenderThatIsNotThereIsFour) {
  const Scratch scratch;
  const std::string cell = (scratch / "cell2.toml").string();
  std::ofstream(cell) << "schema = \"bendloop.cell/1\"\nname = \"test\"\n"
                      << "part = \"" BENDLOOP_SOURCE_DIR "/config/parts/demo.toml\"\n"
                      << "state_dir = \"state\"\n[scanner]\nkind = \"simulated\"\n"
                      << "[bender]\nlink = \"modbus-tcp\"\nport = 1\nregister_map = \""
                      << BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml\"\n";
  const std::string json = (scratch / "result.json").string();
  const Ran ran =
      scratch.Bendloop("replay " + Simulate(scratch, "") + " --config " + cell + " --json " + json);
  EXPECT_EQ(ran.code, 4) << ran.err;
  // What failed, where and the mend come first.
  EXPECT_THAT(ran.err, StartsWith("bendloop: bender 127.0.0.1:1 unit 1: cannot connect"));
  EXPECT_THAT(ran.err.substr(0, ran.err.find('\n')), HasSubstr("check that the controller runs"));
  const auto result = host::ReadResultJson(Slurp(json), json);  // measured all the same
  ASSERT_TRUE(result && result->bender);
  EXPECT_EQ(result->bender->outcome, host::CommitOutcome::kFailed);
  EXPECT_THAT(result->bender->reason, HasSubstr("cannot connect"));
}

}  // namespace
}  // namespace bendloop::testing
