// SPDX-License-Identifier: Apache-2.0
#include "drivers/canopen_bender/object_table.h"

#include <algorithm>
#include <optional>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"

namespace bendloop::drivers {
namespace {

class Table {
 public:
  explicit Table(const hal::RegisterMap& map) : map_(map) {}

  void Add(const hal::RegisterField& field, bool is_written) {
    const std::size_t bytes =
        field.type == hal::RegisterType::kUint8 ? 1 : 2u * RegisterCount(field.type);
    Add({field.object, RangeOf(field), bytes, false, is_written});
  }
  void Add(const std::optional<hal::RegisterField>& field, bool is_written) {
    if (field) Add(*field, is_written);
  }
  void Add(const std::optional<hal::TextField>& field, bool is_written) {
    if (!field) return;
    Add({field->object, RangeOf(*field), 2 * std::size_t{field->registers()}, true, is_written});
  }
  void Add(const hal::ProgramArea& area, bool is_written) {
    const RegisterRange rows = RowsRange(map_, area, map_.max_rows);
    Add({area.rows_object, rows, 2 * std::size_t{rows.count}, true, is_written});
    for (const auto* field : {&area.part_number, &area.sequence, &area.crc, &area.row_count}) {
      Add(*field, is_written);
    }
  }
  std::vector<MappedObject> Take() { return std::move(objects_); }

 private:
  // A bender without a commit has one program, which is both active and staged.
  void Add(const MappedObject& object) {
    const auto same = std::find_if(objects_.begin(), objects_.end(), [&](const MappedObject& o) {
      return o.object == object.object;
    });
    if (same == objects_.end()) return objects_.push_back(object);
    same->is_written |= object.is_written;
  }

  const hal::RegisterMap& map_;
  std::vector<MappedObject> objects_;
};

}  // namespace

std::vector<MappedObject> ObjectsOf(const hal::RegisterMap& map) {
  Table table(map);
  table.Add(map.mode, false);
  table.Add(map.fault_code, false);
  table.Add(map.heartbeat, false);
  table.Add(map.parts_bent, false);
  table.Add(map.reply_sequence, false);
  table.Add(map.reply, false);
  table.Add(map.reply_code, false);
  table.Add(map.active, false);
  table.Add(map.staging, true);
  table.Add(map.commit, true);
  const hal::OrderFields& orders = map.orders;
  for (const auto* field :
       {&orders.part_number, &orders.scan, &orders.hold, &orders.new_lot, &orders.acknowledge}) {
    table.Add(*field, false);
  }
  table.Add(orders.identity, false);
  const hal::ReportFields& report = map.report;
  for (const auto* field :
       {&report.heartbeat, &report.state, &report.alarm, &report.alarms, &report.verdict,
        &report.part_number, &report.worst_percent, &report.tubes, &report.passed, &report.failed,
        &report.undecided, &report.held, &report.part_set, &report.acknowledged,
        &report.lot_begun}) {
    table.Add(*field, true);
  }
  table.Add(report.identity, true);
  table.Add(report.sequence, true);
  return table.Take();
}

std::vector<std::uint8_t> ToBytes(const std::uint16_t* words, std::size_t bytes) {
  std::vector<std::uint8_t> out(bytes);
  for (std::size_t i = 0; i < bytes; ++i) {
    out[i] = static_cast<std::uint8_t>(words[i / 2] >> (i % 2 == 0 ? 8 : 0));
  }
  return out;
}

void FromBytes(std::span<const std::uint8_t> bytes, std::uint16_t* words) {
  for (std::size_t i = 0; i < bytes.size(); i += 2) {
    const unsigned second = i + 1 < bytes.size() ? bytes[i + 1] : 0u;
    words[i / 2] = static_cast<std::uint16_t>(bytes[i] << 8 | second);
  }
}

}  // namespace bendloop::drivers
