// SPDX-License-Identifier: Apache-2.0
//
// Peers that share no code with ours: mbpoll plays the PLC's client, a pymodbus server the bender.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <vector>

#include "firmware-host/commit/commit_protocol.h"
#include "tests/support/child_process.h"
#include "tests/support/modbus_bender_under_test.h"

namespace bendloop::test {
namespace {

bool HasMbpoll() { return std::system("command -v mbpoll >/dev/null") == 0; }
bool HasPymodbus() {
  return std::system("/usr/bin/python3 -c 'import pymodbus.server' >/dev/null 2>&1") == 0;
}

std::vector<std::string> Mbpoll(int port, const std::string& words) {
  std::vector<std::string> command{"mbpoll", "-m", "tcp", "-p", std::to_string(port), "-a", "1",
                                   "-0",     "-1", "-o",  "10"};
  std::istringstream split(words);
  for (std::string word; split >> word;) command.push_back(word);
  return command;
}

// Registers as mbpoll prints them: "[100]: \t42".
std::vector<int> MbpollRead(int port, int type, int address, int count) {
  ChildProcess mbpoll(Mbpoll(port, "-t " + std::to_string(type) + " -r " + std::to_string(address) +
                                       " -c " + std::to_string(count) + " 127.0.0.1"));
  std::vector<int> values;
  int at = 0;
  int value = 0;
  while (const auto line = mbpoll.ReadLine()) {
    if (std::sscanf(line->c_str(), "[%d]: %d", &at, &value) == 2) values.push_back(value);
  }
  EXPECT_EQ(mbpoll.Wait(), 0);
  EXPECT_EQ(values.size(), static_cast<std::size_t>(count));
  values.resize(static_cast<std::size_t>(count));
  return values;
}

int MbpollWrite(int port, int address, const std::string& values) {
  ChildProcess mbpoll(Mbpoll(port, "-t 4 -r " + std::to_string(address) + " 127.0.0.1 " + values));
  mbpoll.ReadAll();
  return mbpoll.Wait();
}

TEST(IndependentPeers, MbpollStagesAndCommitsAtTheSimulatedBender) {
  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is missing: apt-get install mbpoll";
  drivers::SimulatedBenderOptions options = SimulatorOptions(PlainMap());
  options.program.part_number = 7;
  const auto bender = StartBender(options);
  const int port = bender->port();
  // Our own master stays connected beside it.
  hal::SteadyClock clock;
  const auto link = drivers::MakeModbusBender(PlainMap(), LinkOptions(bender->port()), clock);
  ASSERT_TRUE(link->ReadActive());
  EXPECT_EQ(MbpollRead(port, 4, 0, 1)[0], 1);  // idle
  // The worked example of drivers/README.md.
  EXPECT_EQ(MbpollWrite(port, 1010, "1 34464 0 0 0 45500 0 30000 1 14714 0 0 0 0 0 0"), 0);
  EXPECT_EQ(MbpollWrite(port, 1000, "0 7 0 12 2 44268 5192"), 0);  // crc 0xACEC1448
  EXPECT_EQ(MbpollWrite(port, 2000, "0 12"), 0);
  EXPECT_EQ(MbpollRead(port, 4, 3, 4), (std::vector<int>{1, 0, 0, 12}));  // accepted
  const hal::ProgramBlock active = bender->Active();
  EXPECT_EQ(active.sequence, 12u);
  const hal::BendProgram expected{{{100, 0, 45.5, 30}, {80.25, 0, 0, {}}}};
  EXPECT_EQ(active.program, expected);
  // One flipped bit in the next one is rejected: code 1, the crc.
  EXPECT_EQ(MbpollWrite(port, 1000, "0 7 0 13 2 44268 5192"), 0);
  EXPECT_EQ(MbpollWrite(port, 2000, "0 13"), 0);
  EXPECT_EQ(MbpollRead(port, 4, 3, 4), (std::vector<int>{2, 1, 0, 13}));
  EXPECT_EQ(bender->Active(), active);
  const auto seen = link->ReadActive();
  ASSERT_TRUE(seen) << seen.error().message;
  EXPECT_EQ(*seen, active);
  EXPECT_NE(MbpollWrite(port, 102, "0 13"), 0);  // the active program cannot be written
}

TEST(IndependentPeers, ProgramIsCommittedToAPymodbusBender) {
  if (!HasPymodbus()) {
    GTEST_SKIP() << "pymodbus is missing: apt-get install python3-pymodbus";
  }
  ChildProcess bender(
      {"/usr/bin/python3", BENDLOOP_SOURCE_DIR "/tests/unit/commit/pymodbus_bender.py"});
  const auto line = bender.ReadLine();
  ASSERT_TRUE(line);
  int port = 0;
  ASSERT_EQ(std::sscanf(line->c_str(), "listening %d", &port), 1) << *line;

  hal::SteadyClock clock;
  drivers::ModbusBenderOptions options = LinkOptions(static_cast<std::uint16_t>(port));
  options.response_timeout = std::chrono::seconds(10);  // python on a loaded machine
  const auto link = drivers::MakeModbusBender(OddMap(), options, clock);
  const auto base = link->ReadActive();
  ASSERT_TRUE(base) << base.error().message;
  ASSERT_EQ(base->program.rows.size(), 4u);
  const hal::BendRow expected[] = {
      {100, 0, 45, {}}, {50, 90, 30, {}}, {20, -30, 60, {}}, {10, 0, 0, {}}};
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(base->program.rows[i].length_mm, expected[i].length_mm, 1e-4);
    EXPECT_NEAR(base->program.rows[i].rotation_deg, expected[i].rotation_deg, 1e-9);
    EXPECT_NEAR(base->program.rows[i].angle_deg, expected[i].angle_deg, 1e-9);
  }
  auto journal = host::CommitJournal::Open(":memory:").value();
  host::CommitOptions commit_options;
  commit_options.heartbeat_timeout = commit_options.reply_timeout = std::chrono::seconds(20);
  host::CommitProtocol protocol(*link, journal, clock, commit_options);
  hal::BendProgram corrected = base->program;
  corrected.rows[0].angle_deg += 1.25;
  corrected.rows[1].rotation_deg -= 2.5;
  corrected.rows[2].length_mm += 0.5;
  const host::CommitReport report = protocol.Commit({"scan", *base, corrected});
  ASSERT_EQ(report.outcome, host::CommitOutcome::kCommitted) << report.reason;

  if (!HasMbpoll()) GTEST_SKIP() << "mbpoll is missing: apt-get install mbpoll";
  EXPECT_EQ(MbpollRead(port, 3, 100, 3), (std::vector<int>{42, 4, 4}));
  EXPECT_EQ(MbpollRead(port, 3, 200, 2), (std::vector<int>{4625, 0}));
  EXPECT_EQ(MbpollRead(port, 3, 205, 2), (std::vector<int>{3000, 27250}));
  EXPECT_EQ(MbpollRead(port, 3, 30, 2), (std::vector<int>{4, 7}));

  // A staged program that mbpoll damages on the way is rejected by the peer's own crc.
  ASSERT_TRUE(link->Stage({42, 9, corrected, 0}));
  EXPECT_EQ(MbpollWrite(port, 600, "4626"), 0);
  ASSERT_TRUE(link->Commit(9));
  EXPECT_EQ(link->ReadState()->reply, hal::CommitReply::kRejected);
  EXPECT_EQ(link->ReadActive().value(), *report.active);
}

}  // namespace
}  // namespace bendloop::test
