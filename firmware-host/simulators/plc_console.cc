// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/simulators/plc_console.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <limits>
#include <optional>
#include <system_error>

namespace bendloop::host {
namespace {

constexpr std::uint32_t kMost = std::numeric_limits<std::uint32_t>::max();

std::optional<std::uint32_t> NumberUpTo(std::uint32_t most, std::string_view text) {
  std::uint32_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || number > most) {
    return std::nullopt;
  }
  return number;
}

bool IsText(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

const char* Word(hal::CellState state) {
  constexpr std::array kWords{"starting",   "idle", "scanning", "measuring",
                              "committing", "held", "fault"};
  const auto at = static_cast<std::size_t>(state);
  return at < kWords.size() ? kWords[at] : "unknown";
}

const char* Word(hal::TubeVerdict verdict) {
  constexpr std::array kWords{"none", "pass", "fail", "undecided", "held"};
  const auto at = static_cast<std::size_t>(verdict);
  return at < kWords.size() ? kWords[at] : "unknown";
}

}  // namespace

std::string_view PlcOrderHelp() {
  return "  part_number N      of the tube that is scanned next; 0: the cell file's own\n"
         "  identity TEXT      of that tube, up to 32 characters; without TEXT none\n"
         "  scan N             0: as the scanner says, 1: a scan may run, 2: it is over\n"
         "  hold N             1: correct nothing, 0: go on\n"
         "  new_lot N          another number than before, but 0, asks for a new lot\n"
         "  acknowledge N      another number than before, but 0, acknowledges all alarms\n";
}

hal::Result<hal::PlcOrders> PlcOrderOf(std::string_view words, const hal::OrderFields& fields) {
  const std::size_t blank = std::min(words.find(' '), words.size());
  const std::string_view field = words.substr(0, blank);
  const std::string_view value = words.substr(std::min(blank + 1, words.size()));
  const auto bad = [&](const std::string& expected) {
    return hal::Fail(hal::ErrorKind::kUsage,
                     "say \"" + std::string(words) + "\": expected " + expected);
  };
  hal::PlcOrders orders;
  bool has_field = false;
  if (field == "identity") {
    has_field = fields.identity.has_value();
    if (has_field && (value.size() > fields.identity->characters || !IsText(value))) {
      return bad("up to " + std::to_string(fields.identity->characters) + " characters of ASCII");
    }
    orders.identity = std::string(value);
  } else if (field == "scan") {
    has_field = fields.scan.has_value();
    const auto number = NumberUpTo(2, value);
    if (!number) return bad("0, 1 or 2");
    orders.scan = static_cast<hal::ScanOrder>(*number);
  } else if (field == "hold") {
    has_field = fields.hold.has_value();
    const auto number = NumberUpTo(1, value);
    if (!number) return bad("0 or 1");
    orders.hold = *number != 0;
  } else {
    struct Numbered {
      std::string_view name;
      bool has_field;
      std::optional<std::uint32_t> hal::PlcOrders::*order;
    };
    const Numbered numbered[] = {
        {"part_number", fields.part_number.has_value(), &hal::PlcOrders::part_number},
        {"new_lot", fields.new_lot.has_value(), &hal::PlcOrders::new_lot},
        {"acknowledge", fields.acknowledge.has_value(), &hal::PlcOrders::acknowledge}};
    const auto* const found =
        std::find_if(std::begin(numbered), std::end(numbered),
                     [&](const Numbered& known) { return known.name == field; });
    if (found == std::end(numbered)) {
      return bad("part_number, identity, scan, hold, new_lot or acknowledge");
    }
    has_field = found->has_field;
    const auto number = NumberUpTo(kMost, value);
    if (!number) return bad("a number of 0 to 4294967295");
    orders.*found->order = number;
  }
  if (!has_field)
    return bad("a field of the register map, which has no orders." + std::string(field));
  return orders;
}

std::string Told(const hal::CellReport& report, const hal::ReportFields& fields) {
  std::string line;
  const auto add = [&](const char* name, bool has_field, const std::string& value) {
    if (has_field) line += (line.empty() ? "" : ", ") + std::string(name) + " " + value;
  };
  const auto count = [&](const char* name, const std::optional<hal::RegisterField>& field,
                         std::uint32_t value) {
    add(name, field.has_value(), std::to_string(value));
  };
  const auto named = [&](const char* name, const std::optional<hal::RegisterField>& field,
                         auto value) {
    add(name, field.has_value(), std::to_string(static_cast<unsigned>(value)) + " " + Word(value));
  };
  count("heartbeat", fields.heartbeat, report.heartbeat);
  named("state", fields.state, report.state);
  count("alarm", fields.alarm, report.alarm);
  count("alarms", fields.alarms, report.alarms);
  count("part_set", fields.part_set, report.part_set);
  count("acknowledged", fields.acknowledged, report.acknowledged);
  count("lot_begun", fields.lot_begun, report.lot_begun);
  count("sequence", fields.sequence, report.sequence);
  named("verdict", fields.verdict, report.verdict);
  count("worst_percent", fields.worst_percent, report.worst_percent);
  count("part_number", fields.part_number, report.part_number);
  add("identity", fields.identity.has_value(), "\"" + report.identity + "\"");
  count("tubes", fields.tubes, report.tubes);
  count("passed", fields.passed, report.passed);
  count("failed", fields.failed, report.failed);
  count("undecided", fields.undecided, report.undecided);
  count("held", fields.held, report.held);
  return line;
}

}  // namespace bendloop::host
