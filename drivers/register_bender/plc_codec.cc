// SPDX-License-Identifier: Apache-2.0
#include "drivers/register_bender/plc_codec.h"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/register_bender/field_codec.h"

namespace bendloop::drivers {
namespace {

using hal::CellReport;
using hal::RegisterField;

constexpr auto kOver = static_cast<std::uint32_t>(hal::ScanOrder::kOver);

enum class Overflow : std::uint8_t { kWraps, kStops, kRefused };

// A number of the report and its field.
struct Entry {
  const std::optional<RegisterField>& field;
  std::uint32_t& value;
  const char* name;
  Overflow overflow = Overflow::kWraps;
};

// Visits all numbers but those of enumerations.
template <class F>
void VisitNumbers(const hal::ReportFields& fields, CellReport& report, F&& visit) {
  const Entry entries[] = {
      {fields.heartbeat, report.heartbeat, "report.heartbeat"},
      {fields.alarm, report.alarm, "report.alarm", Overflow::kRefused},
      {fields.alarms, report.alarms, "report.alarms", Overflow::kStops},
      {fields.sequence, report.sequence, "report.sequence"},
      {fields.part_number, report.part_number, "report.part_number", Overflow::kRefused},
      {fields.worst_percent, report.worst_percent, "report.worst_percent", Overflow::kStops},
      {fields.tubes, report.tubes, "report.tubes"},
      {fields.passed, report.passed, "report.passed"},
      {fields.failed, report.failed, "report.failed"},
      {fields.undecided, report.undecided, "report.undecided"},
      {fields.held, report.held, "report.held"},
      {fields.part_set, report.part_set, "report.part_set", Overflow::kRefused},
      {fields.acknowledged, report.acknowledged, "report.acknowledged"},
      {fields.lot_begun, report.lot_begun, "report.lot_begun"}};
  for (const Entry& entry : entries) {
    if (entry.field) visit(entry);
  }
}

void Add(const std::optional<RegisterField>& field, std::vector<RegisterRange>& ranges) {
  if (field) ranges.push_back(RangeOf(*field));
}

void Add(const std::optional<hal::TextField>& field, std::vector<RegisterRange>& ranges) {
  if (field) ranges.push_back(RangeOf(*field));
}

hal::Result<void> Read(const hal::RegisterMap& map, const std::optional<RegisterField>& field,
                       const char* name, const RegisterImage& image,
                       std::optional<std::uint32_t>& value) {
  if (!field) return {};
  const auto read = GetInteger(map, *field, name, image);
  if (!read) return hal::Fail(read.error());
  value = *read;
  return {};
}

}  // namespace

std::vector<RegisterRange> OrderRanges(const hal::OrderFields& fields) {
  std::vector<RegisterRange> ranges;
  for (const auto* field :
       {&fields.part_number, &fields.scan, &fields.hold, &fields.new_lot, &fields.acknowledge}) {
    Add(*field, ranges);
  }
  Add(fields.identity, ranges);
  return ranges;
}

hal::Result<hal::PlcOrders> DecodeOrders(const hal::RegisterMap& map, const RegisterImage& image) {
  const hal::OrderFields& fields = map.orders;
  hal::PlcOrders orders;
  std::optional<std::uint32_t> scan;
  std::optional<std::uint32_t> hold;
  auto ok = Read(map, fields.part_number, "orders.part_number", image, orders.part_number);
  if (ok) ok = Read(map, fields.scan, "orders.scan", image, scan);
  if (ok) ok = Read(map, fields.hold, "orders.hold", image, hold);
  if (ok) ok = Read(map, fields.new_lot, "orders.new_lot", image, orders.new_lot);
  if (ok) ok = Read(map, fields.acknowledge, "orders.acknowledge", image, orders.acknowledge);
  if (!ok) return hal::Fail(ok.error());
  if (scan) orders.scan = static_cast<hal::ScanOrder>(std::min(*scan, kOver));
  if (hold) orders.hold = *hold != 0;
  if (fields.identity) {
    const auto text = GetText(map, *fields.identity, image);
    orders.identity = text.value_or("");
    orders.identity_is_text = text.has_value();
  }
  return orders;
}

void EncodeOrders(const hal::RegisterMap& map, const hal::PlcOrders& orders, RegisterImage& image) {
  const auto put = [&](const std::optional<RegisterField>& field,
                       const std::optional<std::uint32_t>& value) {
    if (field && value) (void)PutField(map, *field, *value, "orders", image);
  };
  const hal::OrderFields& fields = map.orders;
  put(fields.part_number, orders.part_number);
  if (orders.scan) put(fields.scan, static_cast<std::uint32_t>(*orders.scan));
  put(fields.hold, orders.hold);
  put(fields.new_lot, orders.new_lot);
  put(fields.acknowledge, orders.acknowledge);
  if (fields.identity && orders.identity) PutText(map, *fields.identity, *orders.identity, image);
}

std::vector<RegisterRange> ReportRanges(const hal::ReportFields& fields) {
  std::vector<RegisterRange> ranges;
  CellReport unused;
  VisitNumbers(fields, unused, [&](const Entry& entry) {
    if (&entry.field != &fields.sequence) ranges.push_back(RangeOf(*entry.field));
  });
  Add(fields.state, ranges);
  Add(fields.verdict, ranges);
  Add(fields.identity, ranges);
  return ranges;
}

std::vector<RegisterRange> ReportSequenceRanges(const hal::ReportFields& fields) {
  std::vector<RegisterRange> ranges;
  Add(fields.sequence, ranges);
  return ranges;
}

hal::Result<void> EncodeReport(const hal::RegisterMap& map, const CellReport& report,
                               RegisterImage& image) {
  hal::Result<void> all = {};
  CellReport copy = report;
  VisitNumbers(map.report, copy, [&](const Entry& entry) {
    const std::uint32_t most = MaxInteger(*entry.field);
    std::uint32_t value = entry.value;
    if (entry.overflow == Overflow::kStops) value = std::min(value, most);
    if (entry.overflow == Overflow::kWraps && value > most) {
      value = static_cast<std::uint32_t>(value % (std::uint64_t{most} + 1));
    }
    if (auto ok = PutField(map, *entry.field, value, entry.name, image); !ok && all) all = ok;
  });
  const auto put = [&](const std::optional<RegisterField>& field, unsigned value,
                       const char* name) {
    if (!field || !all) return;
    all = PutField(map, *field, value, name, image);
  };
  put(map.report.state, static_cast<unsigned>(report.state), "report.state");
  put(map.report.verdict, static_cast<unsigned>(report.verdict), "report.verdict");
  if (map.report.identity) PutText(map, *map.report.identity, report.identity, image);
  return all;
}

hal::Result<CellReport> DecodeReport(const hal::RegisterMap& map, const RegisterImage& image) {
  CellReport report;
  hal::Result<void> all = {};
  const auto read = [&](const RegisterField& field, const char* name) -> std::uint32_t {
    const auto value = GetInteger(map, field, name, image);
    if (!value && all) all = hal::Fail(value.error());
    return value.value_or(0);
  };
  VisitNumbers(map.report, report,
               [&](const Entry& entry) { entry.value = read(*entry.field, entry.name); });
  if (map.report.state) {
    report.state = static_cast<hal::CellState>(read(*map.report.state, "report.state"));
  }
  if (map.report.verdict) {
    report.verdict = static_cast<hal::TubeVerdict>(read(*map.report.verdict, "report.verdict"));
  }
  if (map.report.identity) {
    report.identity = GetText(map, *map.report.identity, image).value_or("");
  }
  if (!all) return hal::Fail(all.error());
  return report;
}

}  // namespace bendloop::drivers
