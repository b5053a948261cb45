// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/service_unit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "firmware-host/cell/service_needs.h"
#include "firmware-host/cell/tube_rules.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using std::chrono_literals::operator""s;
using std::chrono_literals::operator""ms;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(TimeSpan, IsReadAsSystemdDoes) {
  EXPECT_EQ(TimeSpan("20"), 20s);
  EXPECT_EQ(TimeSpan(" 1min 30s "), 90s);
  EXPECT_EQ(TimeSpan("1min30s"), 90s);
  EXPECT_EQ(TimeSpan("2 hours"), 7200s);
  EXPECT_EQ(TimeSpan("1.5s"), 1500ms);
  EXPECT_EQ(TimeSpan("250ms"), 250ms);
  EXPECT_EQ(TimeSpan("infinity"), std::chrono::nanoseconds::max());
  EXPECT_EQ(TimeSpan("90000000000w"), std::chrono::nanoseconds::max());
  for (const char* none : {"", "soon", "5 parsecs", "-3", "inf", "nan", "3s4x"}) {
    EXPECT_EQ(TimeSpan(none), std::nullopt) << none;
  }
}

class ServiceUnit : public ::testing::Test {
 protected:
  ServiceUnit() {
    std::string name = (fs::temp_directory_path() / "unit-XXXXXX").string();
    root_ = mkdtemp(name.data());
    places_ = {root_ / "etc", root_ / "run", root_ / "usr/local/lib", root_ / "usr/lib"};
  }
  ~ServiceUnit() override { fs::remove_all(root_); }

  // Returns the file's name.
  std::string Put(const std::string& file, const std::string& text) {
    const fs::path path = root_ / file;
    fs::create_directories(path.parent_path());
    std::ofstream(path) << text;
    return path.string();
  }
  std::string PutShipped() {
    std::ifstream shipped(BENDLOOP_SOURCE_DIR "/systemd/bendloopd.service");
    return Put("usr/lib/systemd/system/bendloopd.service",
               {std::istreambuf_iterator<char>(shipped), {}});
  }
  void ExpectStop(std::chrono::nanoseconds stop, const std::string& from) const {
    const ServiceTimes times = TimesOfUnit(places_);
    EXPECT_EQ(times.stop, stop);
    EXPECT_EQ(times.stop_from, from);
  }

  fs::path root_;
  UnitPlaces places_;
};

TEST_F(ServiceUnit, IsTheShippedOneWhereNoneIsInstalled) { ExpectStop(ServiceTimes().stop, ""); }

TEST_F(ServiceUnit, TellsTheTimeOfTheDropInThatCounts) {
  const std::string unit = PutShipped();
  ExpectStop(20s, unit);
  const std::string cell =
      Put("etc/systemd/system/bendloopd.service.d/50-cell.conf", "[Service]\nTimeoutStopSec=34\n");
  ExpectStop(34s, cell);
  // By their names, not their folders; files of other names, and hidden ones, are no drop-ins.
  Put("usr/lib/systemd/system/bendloopd.service.d/40-vendor.conf", "[Service]\nTimeoutStopSec=5\n");
  Put("etc/systemd/system/bendloopd.service.d/60-x.conf.bak", "[Service]\nTimeoutStopSec=6\n");
  ExpectStop(34s, cell);
  const std::string last = Put("usr/lib/systemd/system/bendloopd.service.d/90-site.conf",
                               "[Service]\nTimeoutStopSec=1min\n");
  ExpectStop(60s, last);
  // /etc takes the place of /usr/lib's file of the same name.
  Put("etc/systemd/system/bendloopd.service.d/90-site.conf", "");
  ExpectStop(34s, cell);
}

TEST_F(ServiceUnit, ReadsWhatSystemdReads) {
  const std::string unit = "usr/lib/systemd/system/bendloopd.service";
  const auto stop = [&](const std::string& text) {
    Put(unit, text);
    return TimesOfUnit(places_).stop;
  };
  EXPECT_EQ(stop("[Service]\nExecStart=/bin/true\n"), 90s);  // systemd's own
  EXPECT_EQ(stop("[Service]\n TimeoutStopSec = 7 \n"), 7s);
  EXPECT_EQ(stop("[Service]\nTimeoutSec=8\n"), 8s);
  EXPECT_EQ(stop("[Service]\nTimeoutStopSec=7\nTimeoutStopSec=9\n"), 9s);
  EXPECT_EQ(stop("[Service]\nTimeoutStopSec=7\nTimeoutStopSec=whenever\n"), 7s);
  EXPECT_EQ(stop("[Service]\nTimeoutStopSec=0\n"), std::chrono::nanoseconds::max());
  EXPECT_EQ(stop("[Service]\n#TimeoutStopSec=7\n;TimeoutStopSec=7\n"), 90s);
  EXPECT_EQ(stop("[Unit]\nTimeoutStopSec=7\n[Service]\nRestart=no\n"), 90s);
  EXPECT_EQ(stop("[Service]\nTimeoutStopSec=1min \\\n 5s\n"), 65s);
}

TEST_F(ServiceUnit, OneCopiedToEtcCountsInPlaceOfThePackages) {
  const std::string shipped = PutShipped();
  const std::string copied =
      Put("etc/systemd/system/bendloopd.service", "[Service]\nTimeoutStopSec=11\n");
  ExpectStop(11s, copied);
  EXPECT_THAT(UnitFiles(places_), ElementsAre(copied, shipped));
}

// What the cell's own drop-in mends is no remark any more.
TEST_F(ServiceUnit, TheCellsDropInEndsTheRemark) {
  const std::string unit = PutShipped();
  config::CellConfig cell;
  cell.bender.link = config::BenderKind::kModbusTcp;
  cell.bender.register_map.parts_bent.emplace();
  cell.bender.commit_timeout = 40s;
  EXPECT_THAT(RemarksOn(cell, TimesOfUnit(places_)), ElementsAre(HasSubstr("(" + unit + ")")));
  Put("etc/systemd/system/bendloopd.service.d/50-cell.conf",
      UnitDropIn(NeedsOf(cell), "cell.toml"));
  EXPECT_THAT(RemarksOn(cell, TimesOfUnit(places_)), IsEmpty());
}

}  // namespace
}  // namespace bendloop::host
