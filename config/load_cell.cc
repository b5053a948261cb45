// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <iterator>
#include <optional>
#include <utility>

#include "config/fields.h"
#include "config/load.h"
#include "config/object_dictionary.h"
#include "config/parse_file.h"
#include "hal/network_address.h"

namespace bendloop::config {
namespace {

void CheckAddress(TomlDocument& document, const std::string& path, const std::string& host) {
  if (hal::IsNumericAddress(host)) return;
  document.Report(path, "found '" + Printable(host) +
                            "', expected a numeric address such as 192.168.0.10 (looking up a "
                            "name has no bounded time)");
}

void CheckSerialLine(TomlDocument& document, const BenderConfig& bender) {
  constexpr int kBauds[] = {1200,  2400,   4800,   9600,   19200, 38400,
                            57600, 115200, 230400, 460800, 921600};
  if (bender.device.empty()) {
    document.Report("bender.device",
                    "found nothing, expected the serial port of link = 'modbus-rtu', such as "
                    "/dev/ttyS1 or /dev/serial/by-id/...");
  }
  if (std::find(std::begin(kBauds), std::end(kBauds), bender.baud) == std::end(kBauds)) {
    document.Report("bender.baud", "found " + std::to_string(bender.baud) +
                                       ", expected a usual rate: 1200, 2400, 4800, 9600, 19200, "
                                       "38400, 57600, 115200, 230400, 460800 or 921600");
  }
  if (bender.unit_id < 1 || bender.unit_id > 247) {
    document.Report("bender.unit_id", "found " + std::to_string(bender.unit_id) +
                                          ", expected 1 to 247 on a serial line");
  }
}

void CheckCan(TomlDocument& document, const BenderConfig& bender) {
  constexpr std::size_t kLongestName = 15;
  const bool canopen = bender.link == BenderKind::kCanopen;
  if (bender.can_interface.empty() || bender.can_interface.size() > kLongestName) {
    document.Report("bender.can_interface", "found '" + Printable(bender.can_interface) +
                                                "', expected the CAN interface of link = '" +
                                                (canopen ? "canopen" : "can-isotp") +
                                                "', such as can0");
  }
  if (canopen && bender.object_dictionary_file.empty()) {
    document.Report("bender.object_dictionary",
                    "found nothing, expected the EDS file of link = 'canopen'");
  }
  if (!canopen && bender.can_request_id == bender.can_reply_id) {
    document.Report("bender.can_reply_id", "found " + std::to_string(bender.can_reply_id) +
                                               " as in can_request_id, expected another one");
  }
}

void CheckStep(TomlDocument& document, const char* name, double step, double total) {
  if (step <= total) return;
  document.Report(std::string("correction.max_step_") + name, "found " + NumberText(step) +
                                                                  ", expected at most max_total_" +
                                                                  name + " = " + NumberText(total));
}

void CheckScanner(TomlDocument& document, const ScannerConfig& scanner) {
  CheckAddress(document, "scanner.host", scanner.host);
  if (!ParseUsbId(scanner.usb_id)) {
    document.Report("scanner.usb_id", "found '" + Printable(scanner.usb_id) +
                                          "', expected vendor and product number in hexadecimal, "
                                          "such as 1209:0001 (lsusb shows them)");
  }
  if (scanner.kind == ScannerKind::kSession && scanner.session.empty() &&
      document.IsGood("scanner")) {
    document.Report("scanner.session",
                    "found nothing, expected the recording that kind = 'session' plays");
  }
}

// Times that cannot be kept together would show on the shop floor only, in the middle of a commit.
void CheckTimes(TomlDocument& document, const CellConfig& cell) {
  const BenderConfig& bender = cell.bender;
  if (bender.link != BenderKind::kNone && bender.commit_timeout < bender.response_timeout) {
    document.Report("bender.commit_timeout_ms",
                    "found " + std::to_string(bender.commit_timeout.count()) +
                        ", expected at least response_timeout_ms = " +
                        std::to_string(bender.response_timeout.count()) +
                        ": the acknowledgement could not even be read");
  }
  const double age_ms = cell.interlocks.max_session_age_s * 1000;
  if (bender.link != BenderKind::kNone &&
      static_cast<double>(bender.commit_timeout.count()) > age_ms) {
    document.Report("bender.commit_timeout_ms",
                    "found " + std::to_string(bender.commit_timeout.count()) +
                        ", expected at most max_session_age_s, " + NumberText(age_ms) +
                        " ms: a correction would be too old before it is acknowledged");
  }
  if (cell.scan.end == ScanEnd::kCoverage && cell.scan.silence_seconds > cell.scan.max_seconds) {
    document.Report("scan.silence_seconds",
                    "found " + NumberText(cell.scan.silence_seconds) +
                        ", expected at most max_seconds = " + NumberText(cell.scan.max_seconds));
  }
}

void CheckTubes(TomlDocument& document, const ScanConfig& scan) {
  if (scan.tubes != TubeSource::kEachScan || scan.parts_between == 0) return;
  document.Report(
      "scan.parts_between",
      "found " +
          (scan.parts_between ? std::to_string(*scan.parts_between) : std::string("'auto'")) +
          " with tubes = 'each-scan', expected 0: which tube is scanned is known by "
          "the bender's count alone (tubes = 'counted')");
}

void CheckCell(TomlDocument& document, CellConfig& cell) {
  const BenderConfig& bender = cell.bender;
  const CorrectionConfig& correction = cell.correction;
  CheckScanner(document, cell.scanner);
  CheckTimes(document, cell);
  CheckTubes(document, cell.scan);
  CheckAddress(document, "bender.host", bender.host);
  if (bender.link != BenderKind::kNone && bender.register_map_file.empty() &&
      document.IsGood("bender")) {
    document.Report("bender.register_map",
                    "found nothing, expected the register map file that says how the bender is "
                    "addressed");
  }
  if (bender.link == BenderKind::kModbusRtu && document.IsGood("bender")) {
    CheckSerialLine(document, bender);
  }
  if ((bender.link == BenderKind::kCanIsotp || bender.link == BenderKind::kCanopen) &&
      document.IsGood("bender")) {
    CheckCan(document, bender);
  }
  CheckStep(document, "length_mm", correction.max_step.length_mm, correction.max_total.length_mm);
  CheckStep(document, "rotation_deg", correction.max_step.rotation_deg,
            correction.max_total.rotation_deg);
  CheckStep(document, "angle_deg", correction.max_step.angle_deg, correction.max_total.angle_deg);
  cell.record.directory = (cell.state_dir / cell.record.directory).lexically_normal();
}

// A map of objects belongs to CANopen, with its dictionary, and one of registers to all others.
hal::Result<void> FitMap(BenderConfig& bender, const std::optional<ObjectDictionary>& dictionary,
                         const std::string& place) {
  if (bender.link == BenderKind::kNone) return {};
  if (bender.register_map.of_objects() != dictionary.has_value()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     place + ": found a map of " +
                         (dictionary ? "registers, expected one of CANopen objects (index, sub)"
                                     : "CANopen objects, expected one of registers (address)"));
  }
  if (!dictionary) return {};
  bender.can_vendor_id = dictionary->vendor_number;
  bender.can_product_code = dictionary->product_number;
  return BindObjects(bender.register_map, *dictionary);
}

// What only the cell's files together show. `tubes_place`: of its key, for a message.
hal::Result<void> CheckTogether(const CellConfig& cell, const std::string& tubes_place) {
  if (cell.bender.link == BenderKind::kNone) return {};
  if (cell.scan.tubes == TubeSource::kCounted && !cell.bender.register_map.parts_bent) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     tubes_place +
                         ": found 'counted', expected a register map with state.parts_bent "
                         "(register map " +
                         cell.bender.register_map_file.string() + " has none)");
  }
  return CheckPartFits(cell);
}

}  // namespace

TubeSource TubesOf(const CellConfig& cell) {
  if (cell.scan.tubes != TubeSource::kAuto) return cell.scan.tubes;
  // Nobody bends with a bender that the daemon simulates, and nothing can be harmed.
  if (!IsReal(cell.bender.link)) return TubeSource::kEachScan;
  return cell.bender.register_map.parts_bent ? TubeSource::kCounted : TubeSource::kAuto;
}

hal::Result<void> CheckPartFits(const CellConfig& cell) {
  if (cell.bender.link == BenderKind::kNone) return {};
  const hal::RegisterMap& map = cell.bender.register_map;
  const auto fail = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kBadInput, cell.part_file.string() + ": " + what +
                                                    " (register map " +
                                                    cell.bender.register_map_file.string() + ")");
  };
  const std::size_t rows =
      cell.part.xyz_mm.empty() ? cell.part.rows.rows.size() : cell.part.xyz_mm.size() - 1;
  if (rows > map.max_rows) {
    return fail("found a part of " + std::to_string(rows) + " rows, expected at most " +
                std::to_string(map.max_rows) + ", which the bender holds");
  }
  const double most = hal::RawRangeOf(map.active.part_number.type).max;
  if (cell.part.part_number > most) {
    return fail("found part_number " + std::to_string(cell.part.part_number) +
                ", expected at most " + NumberText(most) + ", which the bender's register holds");
  }
  return {};
}

std::optional<UsbId> ParseUsbId(const std::string& text) {
  constexpr std::size_t kDigits = 4;
  if (text.size() != 2 * kDigits + 1 || text[kDigits] != ':') return std::nullopt;
  UsbId id;
  const char* const begin = text.data();
  const auto vendor = std::from_chars(begin, begin + kDigits, id.vendor, 16);
  const auto product = std::from_chars(begin + kDigits + 1, begin + text.size(), id.product, 16);
  if (vendor.ptr != begin + kDigits || product.ptr != begin + text.size()) return std::nullopt;
  return id;
}

hal::Result<CellConfig> ParseCell(std::string_view toml, std::string_view name,
                                  const std::filesystem::path& directory) {
  return ParseDocument(toml, name, FileKind::kCell, directory, VisitCell, CheckCell, CellConfig());
}

namespace {

// Found out on the shop floor otherwise, part after part.
hal::Result<void> CheckCommitRegister(const CellConfig& cell, const std::string& map_place) {
  const BenderConfig& bender = cell.bender;
  const bool sends = bender.link != BenderKind::kNone && cell.correction.enabled;
  if (!sends || bender.register_map.commit || bender.allow_non_atomic) return {};
  return hal::Fail(
      hal::ErrorKind::kBadInput,
      map_place +
          ": found a map without a commit register, with which no program can be exchanged in one "
          "step: every correction would be refused; expected 'commit' in the map, or, with the "
          "weaker guarantee of drivers/README.md (\"A PLC without a commit register\"), "
          "allow_non_atomic = true in [bender], or enabled = false in [correction]");
}

}  // namespace

hal::Result<CellConfig> LoadCell(const std::filesystem::path& file) {
  const hal::Result<std::string> text = ReadTextFile(file);
  if (!text) return hal::Fail(text.error());
  const std::filesystem::path absolute = std::filesystem::absolute(file).lexically_normal();
  std::string part_place;
  std::string map_place;
  std::string eds_place;
  std::string tubes_place;
  const auto check = [&](TomlDocument& document, CellConfig& parsed) {
    CheckCell(document, parsed);
    part_place = document.Place("part") + ": key 'part'";
    map_place = document.Place("bender.register_map") + ": key 'bender.register_map'";
    eds_place = document.Place("bender.object_dictionary") + ": key 'bender.object_dictionary'";
    tubes_place = document.Place("scan.tubes") + ": key 'scan.tubes'";
  };
  hal::Result<CellConfig> cell =
      ParseDocument(*text, file.string(), FileKind::kCell, absolute.parent_path(), VisitCell, check,
                    CellConfig());
  if (!cell) return cell;
  cell->file = absolute;
  // A setter who mends one file wants to know of the other, too.
  std::string problems;
  const auto add = [&](const std::string& place, const std::filesystem::path& named,
                       const hal::Error& error) {
    std::error_code unknown;
    problems += (problems.empty() ? "" : "\n") +
                (std::filesystem::exists(named, unknown)
                     ? error.message
                     : place + ": found '" + Printable(named.string(), 200) +
                           "', which does not exist (relative paths start at this file's folder)");
  };
  if (hal::Result<PartConfig> part = LoadPart(cell->part_file)) {
    cell->part = std::move(*part);
  } else {
    add(part_place, cell->part_file, part.error());
  }
  if (cell->bender.link != BenderKind::kNone) {
    if (hal::Result<hal::RegisterMap> map = LoadRegisterMap(cell->bender.register_map_file)) {
      cell->bender.register_map = std::move(*map);
    } else {
      add(map_place, cell->bender.register_map_file, map.error());
    }
  }
  std::optional<ObjectDictionary> dictionary;
  if (cell->bender.link == BenderKind::kCanopen) {
    if (auto eds = LoadObjectDictionary(cell->bender.object_dictionary_file)) {
      dictionary = std::move(*eds);
    } else {
      add(eds_place, cell->bender.object_dictionary_file, eds.error());
    }
  }
  if (!problems.empty()) return hal::Fail(hal::ErrorKind::kBadInput, problems);
  hal::Result<void> fits = FitMap(cell->bender, dictionary, map_place);
  if (fits) fits = CheckCommitRegister(*cell, map_place);
  if (!fits) return hal::Fail(fits.error());
  if (hal::Result<void> together = CheckTogether(*cell, tubes_place); !together) {
    return hal::Fail(together.error());
  }
  return cell;
}

}  // namespace bendloop::config
