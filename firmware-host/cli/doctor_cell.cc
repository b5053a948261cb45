// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/doctor_cell.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <memory>
#include <optional>
#include <string_view>
#include <system_error>
#include <utility>

#include "config/load.h"
#include "firmware-host/cell/service_unit.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRule = "udev/rules.d/70-bendloop-scanner.rules";
constexpr const char* kUser = "bendloop";
constexpr const char* kCellFile = "bendloop/cell.toml";

// "bendloop:x:998:" in /etc/passwd or /etc/group.
std::optional<std::string> AccountEntry(const fs::path& path, const std::string& name) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with(name + ":")) return line;
  }
  return std::nullopt;
}

Finding LookAtService(const InstalledPlaces& places) {
  std::error_code error;
  if (!fs::exists(places.run / "systemd/system", error)) {
    return Good("service", "no service manager here");
  }
  const std::string state = places.first_line_of("systemctl is-active bendloopd 2>/dev/null");
  if (state == "active") return Good("service", "bendloopd is active");
  return Bad("service", "bendloopd is " + (state.empty() ? "not known" : state),
             state == "failed"
                 ? "'systemctl status bendloopd' and 'journalctl -u bendloopd' say why"
                 : "systemctl enable --now bendloopd, once /etc/bendloop/cell.toml is "
                   "yours");
}

// Of a name in /etc and in /usr/lib the system takes that in /etc. What was copied there by hand,
// as the manual of version 0.1.0 said, goes on in place of each later package's.
Finding LookForCopies(const InstalledPlaces& places) {
  constexpr const char* kName = "unit and rules";
  const std::vector<fs::path> units =
      UnitFiles({places.etc, places.run, places.local_lib, places.usr_lib});
  std::error_code error;
  if (!units.empty() && !fs::is_regular_file(units.front(), error)) {
    return Bad(kName, units.front().string() + " masks the service", "systemctl unmask bendloopd");
  }
  std::vector<std::pair<fs::path, fs::path>> copies;  // and what they take the place of
  if (units.size() > 1) copies.emplace_back(units[0], units[1]);
  for (const char* file : {"sysusers.d/bendloop.conf", "tmpfiles.d/bendloop.conf", kRule}) {
    if (!fs::is_regular_file(places.etc / file, error)) continue;
    if (!fs::exists(places.usr_lib / file, error)) continue;
    copies.emplace_back(places.etc / file, places.usr_lib / file);
  }
  if (copies.empty()) return Good(kName, units.empty() ? "none installed" : units[0].string());
  std::string found;
  std::string mend = "older copies lack what this version grants and needs: ";
  for (const auto& [copy, packaged] : copies) {
    found +=
        (found.empty() ? "" : "; ") + copy.string() + " is used in place of " + packaged.string();
    mend += "mv " + copy.string() + " " + copy.string() + ".old && ";
  }
  return Bad(kName, found,
             mend +
                 "dpkg-reconfigure bendloop && systemctl reenable bendloopd; settings of your own "
                 "belong in /etc/systemd/system/bendloopd.service.d/");
}

Finding LookForUser(const InstalledPlaces& places) {
  const bool has_user = AccountEntry(places.etc / "passwd", kUser).has_value();
  const bool has_group = AccountEntry(places.etc / "group", kUser).has_value();
  if (has_user && has_group) return Good("user and group", "bendloop");
  return Bad("user and group", std::string("no ") + (has_user ? "group" : "user") + " bendloop",
             "systemd-sysusers, with bendloop.conf in /usr/lib/sysusers.d or /etc/sysusers.d");
}

bool HasRule(const InstalledPlaces& places) {
  std::error_code error;
  return fs::exists(places.etc / kRule, error) || fs::exists(places.usr_lib / kRule, error);
}

// Four digits, as the kernel writes them.
std::string Hex(unsigned number) {
  char text[8];
  std::snprintf(text, sizeof text, "%04x", number);
  return text;
}

std::string ThreeDigits(const std::string& number) {
  return std::string(3 - std::min<std::size_t>(3, number.size()), '0') + number;
}

Finding LookForUsbScanner(const InstalledPlaces& places, const config::ScannerConfig& scanner) {
  const auto id = config::ParseUsbId(scanner.usb_id);
  const std::string rule = HasRule(places) ? "" : "; the udev rule is not installed";
  std::error_code error;
  fs::directory_iterator it(places.machine.sys / "bus/usb/devices", error);
  for (const fs::directory_iterator end; id && !error && it != end; it.increment(error)) {
    if (FirstLine(it->path() / "idVendor") != Hex(id->vendor) ||
        FirstLine(it->path() / "idProduct") != Hex(id->product)) {
      continue;
    }
    if (!scanner.serial.empty() && FirstLine(it->path() / "serial") != scanner.serial) continue;
    const fs::path node = places.machine.dev / "bus/usb" /
                          ThreeDigits(FirstLine(it->path() / "busnum")) /
                          ThreeDigits(FirstLine(it->path() / "devnum"));
    if (places.may_use(node)) return Good("scanner", node.string() + " may be opened" + rule);
    return Bad("scanner", node.string() + " may not be opened by this user" + rule,
               "install config/70-bendloop-scanner.rules to /etc/udev/rules.d, 'udevadm control "
               "--reload && udevadm trigger', and run this as user bendloop");
  }
  return Bad("scanner",
             "no USB device " + scanner.usb_id +
                 (scanner.serial.empty() ? "" : " with serial " + scanner.serial) + rule,
             "check cable and supply, and [scanner] usb_id and serial of the cell file");
}

Finding LookAtScanner(const InstalledPlaces& places, const config::ScannerConfig& scanner) {
  if (scanner.kind == config::ScannerKind::kUsb) return LookForUsbScanner(places, scanner);
  if (scanner.kind == config::ScannerKind::kSession) {
    return Good("scanner", "a recording: " + scanner.session.string());
  }
  return Good("scanner", "over the network, " + scanner.host + ":" + std::to_string(scanner.port));
}

Finding LookAtCan(const InstalledPlaces& places, const std::string& name) {
  const fs::path link = places.machine.sys / "class/net" / name;
  std::error_code error;
  if (!fs::exists(link, error)) {
    return Bad("bender", "no CAN interface " + name,
               "load its driver, and name it in [bender] can_interface");
  }
  // A virtual one says "unknown" when it is up.
  const std::string state = FirstLine(link / "operstate");
  if (state == "up" || state == "unknown") return Good("bender", name + " is up");
  return Bad("bender", name + " is " + state,
             "ip link set " + name + " up type can bitrate 500000, with the bender's bit rate");
}

Finding LookAtBender(const InstalledPlaces& places, const config::BenderConfig& bender) {
  switch (bender.link) {
    case config::BenderKind::kModbusRtu:
      if (places.may_use(bender.device)) return Good("bender", bender.device + " may be opened");
      return Bad("bender", bender.device + " is not there, or not for this user",
                 "check the adapter; the unit is in group dialout, others join it: adduser USER "
                 "dialout");
    case config::BenderKind::kCanIsotp:
    case config::BenderKind::kCanopen:
      return LookAtCan(places, bender.can_interface);
    case config::BenderKind::kModbusTcp:
      return Good("bender", "over the network, " + bender.host + ":" + std::to_string(bender.port));
    case config::BenderKind::kSimulated:
      return Good("bender", "simulated");
    case config::BenderKind::kNone:
      break;
  }
  return Good("bender", "none");
}

Finding LookAtState(const InstalledPlaces& places, const fs::path& directory) {
  std::error_code error;
  if (!fs::exists(directory, error)) {
    return Bad("state directory", directory.string() + " is not there",
               "bendloopd makes it where it may; the unit's StateDirectory= does for "
               "/var/lib/bendloop");
  }
  std::size_t damaged = 0;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    if (it->path().filename().string().find(".db.damaged-") != std::string::npos) ++damaged;
  }
  if (!places.may_use(directory)) {
    return Bad("state directory", directory.string() + " may not be written by this user",
               "run this as the user of the daemon: sudo -u bendloop bendloop doctor");
  }
  if (damaged == 0) return Good("state directory", directory.string());
  return Bad("state directory",
             directory.string() + ": " + std::to_string(damaged) + " files of damaged databases",
             "check the disk (smartctl -a); copy the files away and remove them");
}

}  // namespace

InstalledPlaces SystemPlaces() {
  InstalledPlaces places;
  places.first_line_of = [](const std::string& command) {
    const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
    std::array<char, 256> line{};
    if (!pipe || std::fgets(line.data(), line.size(), pipe.get()) == nullptr) return std::string();
    const std::string_view text(line.data());
    return std::string(text.substr(0, text.find('\n')));
  };
  places.may_use = [](const fs::path& path) { return access(path.c_str(), R_OK | W_OK) == 0; };
  return places;
}

std::vector<Finding> ExamineAll(InstalledPlaces places, fs::path cell_file) {
  std::error_code error;
  if (cell_file.empty() && fs::exists(places.etc / kCellFile, error)) {
    cell_file = places.etc / kCellFile;
  }
  std::optional<hal::Result<config::CellConfig>> cell;
  if (!cell_file.empty()) cell = config::LoadCell(cell_file);
  if (cell && *cell) places.machine.state_dir = (*cell)->state_dir;
  std::vector<Finding> findings = Examine(places.machine);
  const auto add = [&findings](std::vector<Finding> more) {
    for (Finding& finding : more) findings.push_back(std::move(finding));
  };
  add(ExamineInstalled(places));
  if (!cell) return findings;
  if (!*cell) {
    findings.push_back(Bad("cell file", cell->error().message,
                           "the daemon does not start with it: mend it, then 'bendloop check " +
                               cell_file.string() + "'"));
    return findings;
  }
  findings.push_back(Good("cell file", cell_file.string()));
  add(ExamineCell(places, **cell));
  return findings;
}

std::vector<Finding> ExamineInstalled(const InstalledPlaces& places) {
  return {LookAtService(places), LookForCopies(places), LookForUser(places)};
}

std::vector<Finding> ExamineCell(const InstalledPlaces& places, const config::CellConfig& cell) {
  return {LookAtScanner(places, cell.scanner), LookAtBender(places, cell.bender),
          LookAtState(places, cell.state_dir)};
}

}  // namespace bendloop::host
