// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/doctor_cell.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <set>

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class DoctorCell : public ::testing::Test {
 protected:
  DoctorCell() {
    std::string name = (fs::temp_directory_path() / "doctor-XXXXXX").string();
    root_ = mkdtemp(name.data());
    places_.machine = {root_ / "proc", root_ / "sys", root_ / "dev", root_ / "state"};
    places_.etc = root_ / "etc";
    places_.run = root_ / "run";
    places_.local_lib = root_ / "usr/local/lib";
    places_.usr_lib = root_ / "usr/lib";
    places_.first_line_of = [this](const std::string& command) {
      EXPECT_THAT(command, HasSubstr("systemctl is-active bendloopd"));
      return service_;
    };
    places_.may_use = [this](const fs::path& path) { return usable_.count(path) > 0; };
    cell_.state_dir = root_ / "state";
  }
  ~DoctorCell() override { fs::remove_all(root_); }

  void Put(const std::string& file, const std::string& text) {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text << "\n";
  }
  Finding Find(const std::string& name) {
    std::vector<Finding> findings = ExamineInstalled(places_);
    for (Finding& finding : ExamineCell(places_, cell_)) findings.push_back(std::move(finding));
    for (const Finding& finding : findings) {
      EXPECT_EQ(finding.ok, finding.mend.empty()) << finding.name;
      if (finding.name == name) return finding;
    }
    ADD_FAILURE() << name;
    return {};
  }

  fs::path root_;
  InstalledPlaces places_;
  config::CellConfig cell_;
  std::string service_;
  std::set<fs::path> usable_;
};

TEST_F(DoctorCell, LooksAtTheInstalledCellWhereNoneIsNamed) {
  std::map<std::string, Finding> all;
  const auto look = [&](const fs::path& file) {
    all.clear();
    for (Finding& finding : ExamineAll(places_, file)) all[finding.name] = finding;
  };
  look("");
  EXPECT_EQ(all.count("cell file") + all.count("state directory"), 0u);
  Put("etc/bendloop/cell.toml", "schema = \"bendloop.cell/1\"\nnam = \"x\"");
  look("");
  EXPECT_FALSE(all.at("cell file").ok);
  EXPECT_THAT(all.at("cell file").found, HasSubstr("'nam'"));
  EXPECT_THAT(all.at("cell file").mend, HasSubstr("bendloop check " + root_.string()));
  const fs::path config = BENDLOOP_SOURCE_DIR "/config";
  Put("etc/bendloop/cell.toml", "schema = \"bendloop.cell/1\"\nname = \"x\"\npart = \"" +
                                    (config / "parts/demo.toml").string() +
                                    "\"\nstate_dir = \"../gone\"\n[scanner]\nkind = \"stream\"\n" +
                                    "port = 7420\n[bender]\nlink = \"none\"");
  look("");
  EXPECT_EQ(all.at("cell file").found, (root_ / "etc/bendloop/cell.toml").string());
  EXPECT_THAT(all.at("state directory").found, HasSubstr("etc/gone"));
  EXPECT_THAT(all.at("scanner").found, HasSubstr(":7420"));
  look(root_ / "nowhere.toml");
  EXPECT_FALSE(all.at("cell file").ok);
}

TEST_F(DoctorCell, AsksTheServiceManagerWhereThereIsOne) {
  EXPECT_TRUE(Find("service").ok);
  fs::create_directories(root_ / "run/systemd/system");
  EXPECT_FALSE(Find("service").ok);
  service_ = "failed";
  EXPECT_THAT(Find("service").mend, HasSubstr("journalctl"));
  service_ = "active";
  EXPECT_TRUE(Find("service").ok);
}

TEST_F(DoctorCell, TellsOfCopiesThatTakeThePlaceOfThePackagesFiles) {
  const std::string name = "unit and rules";
  EXPECT_TRUE(Find(name).ok);  // nothing is installed
  const std::string shipped = "usr/lib/systemd/system/bendloopd.service";
  const std::string copied = "etc/systemd/system/bendloopd.service";
  Put(shipped, "[Service]");
  EXPECT_TRUE(Find(name).ok);
  EXPECT_THAT(Find(name).found, HasSubstr(shipped));
  Put("etc/systemd/system/bendloopd.service.d/50-cell.conf", "[Service]");
  Put("etc/tmpfiles.d/bendloop.conf", "");  // put there by hand, and there is no package
  EXPECT_TRUE(Find(name).ok);
  Put(copied, "[Service]");
  EXPECT_EQ(Find(name).found,
            (root_ / copied).string() + " is used in place of " + (root_ / shipped).string());
  EXPECT_THAT(Find(name).mend, HasSubstr("mv " + (root_ / copied).string()));
  EXPECT_THAT(Find(name).mend, HasSubstr("dpkg-reconfigure bendloop"));
  fs::remove(root_ / copied);
  Put("usr/lib/tmpfiles.d/bendloop.conf", "");
  EXPECT_THAT(Find(name).found, HasSubstr("etc/tmpfiles.d/bendloop.conf is used in place of"));
  fs::remove(root_ / "etc/tmpfiles.d/bendloop.conf");
  EXPECT_TRUE(Find(name).ok);
  Put("usr/local/lib/systemd/system/bendloopd.service", "[Service]");
  EXPECT_THAT(Find(name).found, HasSubstr("usr/local/lib"));
  EXPECT_FALSE(Find(name).ok);
  fs::create_symlink("/dev/null", root_ / copied);
  EXPECT_THAT(Find(name).mend, HasSubstr("unmask"));
}

TEST_F(DoctorCell, LooksForUserAndGroup) {
  Put("etc/passwd", "bendloopx:x:1:1::/:");
  EXPECT_THAT(Find("user and group").found, HasSubstr("no user"));
  Put("etc/passwd", "root:x:0:0::/:\nbendloop:x:998:998::/:");
  EXPECT_THAT(Find("user and group").found, HasSubstr("no group"));
  Put("etc/group", "bendloop:x:998:");
  EXPECT_TRUE(Find("user and group").ok);
}

TEST_F(DoctorCell, LooksForTheUsbScannerAndItsRights) {
  cell_.scanner.kind = config::ScannerKind::kUsb;
  cell_.scanner.usb_id = "1209:0001";
  cell_.scanner.serial = "B7";
  Put("sys/bus/usb/devices/1-2/idVendor", "1209");
  Put("sys/bus/usb/devices/1-2/idProduct", "0001");
  Put("sys/bus/usb/devices/1-2/serial", "A6");
  EXPECT_THAT(Find("scanner").found, HasSubstr("no USB device 1209:0001 with serial B7"));
  Put("sys/bus/usb/devices/1-2/serial", "B7");
  Put("sys/bus/usb/devices/1-2/busnum", "1");
  Put("sys/bus/usb/devices/1-2/devnum", "14");
  EXPECT_THAT(Find("scanner").found, HasSubstr("bus/usb/001/014 may not be opened"));
  EXPECT_THAT(Find("scanner").found, HasSubstr("the udev rule is not installed"));
  Put("etc/udev/rules.d/70-bendloop-scanner.rules", "");
  usable_.insert(root_ / "dev/bus/usb/001/014");
  EXPECT_TRUE(Find("scanner").ok);
  EXPECT_EQ(Find("scanner").found, (root_ / "dev/bus/usb/001/014").string() + " may be opened");
}

TEST_F(DoctorCell, LooksForTheBender) {
  cell_.bender.link = config::BenderKind::kModbusRtu;
  cell_.bender.device = "/dev/ttyUSB0";
  EXPECT_THAT(Find("bender").mend, HasSubstr("dialout"));
  usable_.insert("/dev/ttyUSB0");
  EXPECT_TRUE(Find("bender").ok);
  cell_.bender.link = config::BenderKind::kCanopen;
  cell_.bender.can_interface = "can0";
  EXPECT_THAT(Find("bender").found, HasSubstr("no CAN interface can0"));
  Put("sys/class/net/can0/operstate", "down");
  EXPECT_FALSE(Find("bender").ok);
  Put("sys/class/net/can0/operstate", "up");
  EXPECT_TRUE(Find("bender").ok);
}

TEST_F(DoctorCell, LooksAtTheStateDirectory) {
  EXPECT_THAT(Find("state directory").found, HasSubstr("is not there"));
  fs::create_directories(cell_.state_dir);
  EXPECT_THAT(Find("state directory").found, HasSubstr("may not be written"));
  usable_.insert(cell_.state_dir);
  EXPECT_TRUE(Find("state directory").ok);
  Put("state/history.db.damaged-20261122T145300Z", "");
  EXPECT_THAT(Find("state directory").found, HasSubstr("1 files of damaged databases"));
}

}  // namespace
}  // namespace bendloop::host
