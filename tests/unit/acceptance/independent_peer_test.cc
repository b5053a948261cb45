// SPDX-License-Identifier: Apache-2.0
//
// A PLC that shares no code with ours, written from drivers/README.md, passes.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "config/load.h"
#include "drivers/modbus_bender/modbus_bender.h"
#include "firmware-host/acceptance/robot.h"
#include "tests/support/child_process.h"
#include "tests/unit/acceptance/simulated_cell.h"

namespace bendloop::test {
namespace {

bool HasPymodbus() {
  return std::system("/usr/bin/python3 -c 'import pymodbus.server' >/dev/null 2>&1") == 0;
}

// Types what is asked for into the PLC's standard input.
class TypedHands final : public host::HandSteps {
 public:
  explicit TypedHands(ChildProcess& plc) : plc_(plc) {}
  bool Do(host::HandStep step) override {
    plc_.WriteLine(host::Word(step));
    return plc_.ReadLine() == "done";
  }

 private:
  ChildProcess& plc_;
};

TEST(AcceptancePeers, APymodbusPlcPasses) {
  if (!HasPymodbus()) GTEST_SKIP() << "pymodbus is missing: apt-get install python3-pymodbus";
  ChildProcess process(
      {"/usr/bin/python3", BENDLOOP_SOURCE_DIR "/tests/unit/acceptance/pymodbus_plc.py"});
  const auto line = process.ReadLine();
  ASSERT_TRUE(line);
  int port = 0;
  ASSERT_EQ(std::sscanf(line->c_str(), "listening %d", &port), 1) << *line;

  hal::SteadyClock clock;
  // Python on a loaded machine takes its time.
  drivers::ModbusBenderOptions options = LinkOptions(static_cast<std::uint16_t>(port));
  options.response_timeout = std::chrono::seconds(10);
  const hal::RegisterMap map =
      config::LoadRegisterMap(BENDLOOP_SOURCE_DIR "/config/register-maps/default.toml").value();
  host::Plc plc(map, drivers::MakeModbusCarrier(map, options, clock), clock);
  const TemporaryFolder folder;
  TypedHands hands(process);
  host::BenchOptions bench = QuickBench();
  bench.reply_timeout = std::chrono::seconds(10);
  const auto result = host::RunAcceptance(plc, host::RestoreFile(folder.path() / "acceptance.json"),
                                          hands, {.bench = bench});
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(Broken(*result), "");
  EXPECT_EQ(Untried(*result), "");
  EXPECT_TRUE(result->passed());
}

}  // namespace
}  // namespace bendloop::test
