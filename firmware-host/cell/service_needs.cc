// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/service_needs.h"

#include <algorithm>
#include <sstream>

#include "drivers/scanner_wire/wire_format.h"
#include "firmware-host/cell/service_times.h"
#include "hal/laser_profile.h"

namespace bendloop::host {
namespace {

bool IsOfThisMachine(const std::string& address) {
  return address == "::1" || address.rfind("127.", 0) == 0;
}

// As the environment's variable has them.
std::vector<std::string> WordsOf(const ServiceNeeds& needs) {
  std::vector<std::string> words;
  if (needs.usb) words.emplace_back("usb");
  if (needs.serial) words.emplace_back("serial");
  if (needs.can) words.emplace_back("can");
  words.insert(words.end(), needs.addresses.begin(), needs.addresses.end());
  return words;
}

// Of a scanner whose profiles are the largest that there are: which one it is shows when it
// answers.
std::uint64_t MemoryMb(std::size_t queue_profiles) {
  constexpr std::uint64_t kProfileBytes =
      drivers::kWireMaxPoints * (sizeof(hal::ProfilePoint) + sizeof(std::uint8_t));
  const std::size_t usual = config::ScannerConfig{}.queue_profiles;
  if (queue_profiles <= usual) return kUnitMemoryMb;
  return kUnitMemoryMb + (((queue_profiles - usual) * kProfileBytes) >> 20) + 1;
}

}  // namespace

ServiceNeeds NeedsOf(const config::CellConfig& cell) {
  ServiceNeeds needs;
  const auto reach = [&](const std::string& address) {
    const auto& known = needs.addresses;
    if (IsOfThisMachine(address)) return;
    if (std::find(known.begin(), known.end(), address) == known.end()) {
      needs.addresses.push_back(address);
    }
  };
  using config::BenderKind;
  using config::ScannerKind;
  const ScannerKind scanner = cell.scanner.kind;
  if (scanner == ScannerKind::kSimulated || scanner == ScannerKind::kStream) {
    reach(cell.scanner.host);
  }
  needs.usb = scanner == ScannerKind::kUsb;
  const BenderKind link = cell.bender.link;
  if (link == BenderKind::kModbusTcp) reach(cell.bender.host);
  needs.serial = link == BenderKind::kModbusRtu;
  needs.can = link == BenderKind::kCanIsotp || link == BenderKind::kCanopen;
  needs.stop = LongestStop(cell);
  needs.memory_mb = MemoryMb(cell.scanner.queue_profiles);
  return needs;
}

std::string UnitDropIn(const ServiceNeeds& needs, const std::string& file) {
  std::ostringstream out;
  out << "# What this cell needs of the machine, and nothing else. Made by\n"
      << "#   bendloop check --unit-drop-in " << file << "\n"
      << "# Goes to /etc/systemd/system/bendloopd.service.d/50-cell.conf; then\n"
      << "#   systemctl daemon-reload && systemctl restart bendloopd\n"
      << "[Service]\n"
      << "# What is written here takes the place of what the unit says.\n"
      << "Environment=\"" << kGrantedVariable << "=";
  std::string blank;
  for (const std::string& word : WordsOf(needs)) {
    out << blank << word;
    blank = " ";
  }
  out << "\"\nRestrictAddressFamilies=\nRestrictAddressFamilies=AF_UNIX AF_INET AF_INET6";
  if (needs.can) out << " AF_CAN";
  if (needs.usb) out << " AF_NETLINK";
  out << "\n";
  for (const std::string& address : needs.addresses) out << "IPAddressAllow=" << address << "\n";
  out << "DeviceAllow=\n";
  if (needs.usb) out << "DeviceAllow=char-usb_device rw\n";
  if (needs.serial) {
    for (const char* kind : {"ttyS", "ttyAMA", "ttyUSB", "ttyACM"}) {
      out << "DeviceAllow=char-" << kind << " rw\n";
    }
  }
  if (!needs.usb && !needs.serial) out << "PrivateDevices=true\n";
  if (needs.stop > ServiceTimes().stop) {
    out << "# A commit on its way is waited for.\nTimeoutStopSec="
        << std::chrono::ceil<std::chrono::seconds>(needs.stop).count() << "\n";
  }
  if (needs.memory_mb > kUnitMemoryMb) {
    out << "# A queue of so many profiles (queue_profiles).\nMemoryMax=" << needs.memory_mb
        << "M\n";
  }
  return out.str();
}

hal::Result<void> CheckGranted(const ServiceNeeds& needs, const char* granted) {
  if (granted == nullptr) return {};
  std::vector<std::string> words;
  std::istringstream in(granted);
  for (std::string word; in >> word;) words.push_back(word);
  for (const std::string& need : WordsOf(needs)) {
    if (std::find(words.begin(), words.end(), need) != words.end()) continue;
    return hal::Fail(
        hal::ErrorKind::kBadInput,
        "the service grants '" + std::string(granted) + "' (" + kGrantedVariable +
            "), and the cell needs " + need +
            ": bendloop check --unit-drop-in CELL.toml writes the drop-in that grants it");
  }
  return {};
}

}  // namespace bendloop::host
