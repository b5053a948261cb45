// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/doctor.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

class DoctorTest : public ::testing::Test {
 protected:
  DoctorTest() {
    std::string name = (fs::temp_directory_path() / "doctor-XXXXXX").string();
    root_ = mkdtemp(name.data());
    places_ = {root_ / "proc", root_ / "sys", root_ / "dev", root_ / "state/not/yet/there"};
  }
  ~DoctorTest() override { fs::remove_all(root_); }

  void Put(const std::string& file, const std::string& text) {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text << "\n";
  }
  Finding Find(const std::string& name) {
    for (const Finding& finding : Examine(places_)) {
      if (finding.name == name) return finding;
    }
    ADD_FAILURE() << name;
    return {};
  }

  fs::path root_;
  DoctorPlaces places_;
};

TEST_F(DoctorTest, EveryWarningHasAMend) {
  for (const Finding& finding : Examine(places_)) {
    EXPECT_FALSE(finding.found.empty()) << finding.name;
    EXPECT_EQ(finding.ok, finding.mend.empty()) << finding.name;
  }
}

TEST_F(DoctorTest, KnowsARealTimeKernel) {
  Put("proc/sys/kernel/osrelease", "6.1.0-rt");
  EXPECT_FALSE(Find("kernel").ok);
  Put("sys/kernel/realtime", "1");
  EXPECT_TRUE(Find("kernel").ok);
}

TEST_F(DoctorTest, OneSlowGovernorIsEnoughToWarn) {
  Put("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance");
  EXPECT_TRUE(Find("CPU frequency").ok);
  Put("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave");
  EXPECT_FALSE(Find("CPU frequency").ok);
}

TEST_F(DoctorTest, SeesCanInterfacesByTheirType) {
  Put("sys/class/net/eth0/type", "1");
  EXPECT_FALSE(Find("CAN").ok);
  Put("sys/class/net/can0/type", "280");
  Put("sys/class/net/can0/operstate", "up");
  EXPECT_EQ(Find("CAN").found, "can0 up");
}

TEST_F(DoctorTest, ASlowClockSourceWarns) {
  Put("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet");
  EXPECT_FALSE(Find("clock source").ok);
  Put("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc");
  EXPECT_TRUE(Find("clock source").ok);
}

}  // namespace
}  // namespace bendloop::host
