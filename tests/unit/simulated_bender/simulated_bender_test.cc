// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/simulated_bender.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "drivers/simulated_bender/misbehaviour.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::drivers {
namespace {

using test::PlainMap;
using test::SimulatorOptions;
using test::StartBender;

class SimulatedBenderTest : public testing::Test {
 protected:
  SimulatedBenderTest()
      : tray_(std::filesystem::path(testing::TempDir()) /
              ("bendloop-tray-" + std::to_string(getpid()) +
               testing::UnitTest::GetInstance()->current_test_info()->name())) {}
  ~SimulatedBenderTest() override { std::filesystem::remove_all(tray_); }

  std::unique_ptr<hal::BenderLink> Link(const SimulatedBender& bender) {
    return MakeModbusBender(PlainMap(), test::LinkOptions(bender.port()), clock_);
  }

  hal::SteadyClock clock_;
  std::filesystem::path tray_;
};

TEST_F(SimulatedBenderTest, BentPartsLieOnTheTrayAsTheyTrulyAre) {
  SimulatedBenderOptions options = SimulatorOptions(PlainMap());
  options.tray = tray_;
  options.physics.springback_20_deg = 1;
  options.physics.springback_120_deg = 3;
  options.physics.sigma_angle_deg = 0.05;
  const auto bender = StartBender(options);
  for (std::uint32_t serial : {1u, 2u}) {
    const auto part = bender->Bend();
    ASSERT_TRUE(part) << part.error().message;
    EXPECT_EQ(part->serial, serial);
    EXPECT_EQ(part->file.filename(), "part-000" + std::to_string(serial) + ".json");
    EXPECT_EQ(part->commanded, bender->Active());
    EXPECT_EQ(part->tube, BendTube(bender->Active().program, options.physics, serial));
    std::ifstream file(part->file);
    const auto json = nlohmann::json::parse(file);
    EXPECT_EQ(json.at("schema"), "bendloop.tray/1");
    EXPECT_EQ(json.at("serial"), serial);
    EXPECT_EQ(json.at("pipe_radius_mm"), 10);
    EXPECT_EQ(json.at("part_number"), 42);
    EXPECT_EQ(json.at("sequence"), 3);
    ASSERT_EQ(json.at("rows").size(), part->tube.rows.size());
    for (std::size_t i = 0; i < part->tube.rows.size(); ++i) {
      const hal::BendRow& row = part->tube.rows[i];
      EXPECT_EQ(json["rows"][i].at("length_mm").get<double>(), row.length_mm);
      EXPECT_EQ(json["rows"][i].at("rotation_deg").get<double>(), row.rotation_deg);
      EXPECT_EQ(json["rows"][i].at("angle_deg").get<double>(), row.angle_deg);
      EXPECT_EQ(json["rows"][i].at("bend_radius_mm").is_null(), !row.bend_radius_mm);
    }
  }
  for (const auto& entry : std::filesystem::directory_iterator(tray_)) {
    EXPECT_EQ(entry.path().extension(), ".json") << "a half-written file stayed";
  }
  EXPECT_EQ(Link(*bender)->ReadState()->parts_bent, 2u);
}

TEST_F(SimulatedBenderTest, TrayThatCannotBeWrittenIsAnError) {
  SimulatedBenderOptions options = SimulatorOptions(PlainMap());
  std::ofstream(tray_) << "a file where a folder should be";
  options.tray = tray_;
  const auto bender = StartBender(options);
  const auto part = bender->Bend();
  ASSERT_FALSE(part);
  EXPECT_EQ(part.error().kind, hal::ErrorKind::kBadInput);
}

TEST_F(SimulatedBenderTest, ShowsBendingDuringACycleAndRejectsCommits) {
  SimulatedBenderOptions options = SimulatorOptions(PlainMap());
  options.cycle = std::chrono::hours(1);
  const auto bender = StartBender(options);
  const auto link = Link(*bender);
  std::thread press([&] { EXPECT_FALSE(bender->Bend()) << "switched off in the cycle"; });
  const auto deadline = clock_.Now() + std::chrono::seconds(20);
  hal::BenderMode mode = hal::BenderMode::kIdle;
  while (mode != hal::BenderMode::kBending && clock_.Now() < deadline) {
    mode = link->ReadState()->mode;
  }
  EXPECT_EQ(mode, hal::BenderMode::kBending);
  EXPECT_FALSE(bender->Bend()) << "one tube at a time";
  std::mt19937_64 random(1);
  ASSERT_TRUE(link->Stage({42, 4, test::RandomProgram(random, 2), 0}));
  ASSERT_TRUE(link->Commit(4));
  const auto state = link->ReadState();
  ASSERT_TRUE(state);
  EXPECT_EQ(state->reply, hal::CommitReply::kRejected);
  EXPECT_EQ(state->reply_code, 5u);
  bender->Stop();
  press.join();
}

// What it says to each staged program; the codes are documented in drivers/README.md.
TEST_F(SimulatedBenderTest, RejectCodes) {
  const auto bender = StartBender(SimulatorOptions(PlainMap()));
  const auto link = Link(*bender);
  const hal::ProgramBlock before = bender->Active();
  std::mt19937_64 random(1);
  const auto reply_to = [&](hal::ProgramBlock block, std::uint32_t sequence) {
    EXPECT_TRUE(link->Stage(block));
    EXPECT_TRUE(link->Commit(0));  // it acts on a change of the register
    EXPECT_TRUE(link->Commit(sequence));
    const auto state = link->ReadState();
    EXPECT_TRUE(state);
    return state->reply_code;
  };
  hal::ProgramBlock block{42, 9, test::RandomProgram(random, 3), 0};
  EXPECT_EQ(reply_to(block, 10), 2u);
  hal::ProgramBlock bad = block;
  bad.program.rows[1].angle_deg = 360;
  EXPECT_EQ(reply_to(bad, 9), 4u);
  bad = block;
  bad.program.rows.back().angle_deg = 20;
  EXPECT_EQ(reply_to(bad, 9), 4u);
  bad = block;
  bad.program.rows.resize(1);
  EXPECT_EQ(reply_to(bad, 9), 3u);
  bad = block;
  bad.sequence = 3;
  EXPECT_EQ(reply_to(bad, 3), 6u);
  bad = block;
  bad.part_number = 43;
  EXPECT_EQ(reply_to(bad, 9), 7u);
  EXPECT_EQ(bender->Active(), before);
  EXPECT_EQ(bender->commits_rejected(), 6u);
  EXPECT_EQ(reply_to(block, 9), 0u);
  EXPECT_EQ(bender->commits_accepted(), 1u);
}

TEST_F(SimulatedBenderTest, ServesSeveralClients) {
  const auto bender = StartBender(SimulatorOptions(PlainMap()));
  std::vector<std::unique_ptr<hal::BenderLink>> links;
  for (int i = 0; i < 8; ++i) links.push_back(Link(*bender));
  for (int round = 0; round < 3; ++round) {
    for (const auto& link : links) EXPECT_EQ(link->ReadActive().value(), bender->Active());
  }
}

TEST_F(SimulatedBenderTest, PortInUseIsAnError) {
  const auto bender = StartBender(SimulatorOptions(PlainMap()));
  SimulatedBenderOptions second = SimulatorOptions(PlainMap());
  second.port = bender->port();
  const auto started = SimulatedBender::Start(second);
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().kind, hal::ErrorKind::kDevice);
  EXPECT_THAT(started.error().message, testing::HasSubstr(std::to_string(second.port)));
}

TEST_F(SimulatedBenderTest, ProgramThatTheMapCannotCarryIsRefusedAtStart) {
  SimulatedBenderOptions options = SimulatorOptions(PlainMap());
  options.program.program.rows.clear();
  EXPECT_FALSE(SimulatedBender::Start(options));
}

TEST(Misbehaviour, EveryFaultOfTheHelpIsUnderstood) {
  std::istringstream help{std::string(MisbehaviourHelp())};
  int faults = 0;
  for (std::string line; std::getline(help, line); ++faults) {
    std::istringstream words(line);
    std::string verb, value;
    words >> verb >> value;
    if (value == "MS" || value == "N" || value == "DEG") verb += " 4";
    if (value == "MODE") verb += " fault";
    if (value == "RULE") verb += " takes-wrong-crc";
    Misbehaviour now;
    EXPECT_TRUE(ParseMisbehaviour(verb, now)) << verb;
  }
  EXPECT_GE(faults, 19);
}

TEST(Misbehaviour, NonsenseIsRefusedWithTheList) {
  for (const char* bad :
       {"", "dance", "late", "late x", "late -5", "late 5 6", "exception 0", "exception 300",
        "mode asleep", "silent now", "reject", "break", "break bones"}) {
    Misbehaviour now;
    const auto parsed = ParseMisbehaviour(bad, now);
    ASSERT_FALSE(parsed) << bad;
    EXPECT_EQ(parsed.error().kind, hal::ErrorKind::kUsage);
    EXPECT_THAT(parsed.error().message, testing::HasSubstr("drop-after-stage"));
  }
}

}  // namespace
}  // namespace bendloop::drivers
