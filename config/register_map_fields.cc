// SPDX-License-Identifier: Apache-2.0
#include <optional>
#include <string_view>
#include <utility>

#include "config/fields.h"
#include "config/plc_fields.h"

namespace bendloop::config {
namespace {

using hal::RegisterField;
using hal::RegisterSpace;
using hal::RegisterType;

constexpr Choice<RegisterSpace> kSpaces[] = {{"holding", RegisterSpace::kHolding},
                                             {"input", RegisterSpace::kInput}};
constexpr Choice<RegisterType> kCountTypes[] = {{"uint16", RegisterType::kUint16},
                                                {"int16", RegisterType::kInt16},
                                                {"uint32", RegisterType::kUint32},
                                                {"int32", RegisterType::kInt32}};
constexpr Choice<RegisterType> kValueTypes[] = {{"uint16", RegisterType::kUint16},
                                                {"int16", RegisterType::kInt16},
                                                {"uint32", RegisterType::kUint32},
                                                {"int32", RegisterType::kInt32},
                                                {"float32", RegisterType::kFloat32}};

// A CANopen object in place of a register; its type stands in the object dictionary.
bool VisitObject(FieldVisitor& v, hal::ObjectAddress& object) {
  if (!v.Chosen("index", object.index != 0)) return false;
  v.Integer("index", object.index, 0x1000, 0xffff, Need::kRequired);
  v.Integer("sub", object.sub, 0, 254);
  return true;
}

// A count, code or number: whole and never negative, so there is nothing to scale.
void VisitCount(FieldVisitor& v, RegisterField& field) {
  if (VisitObject(v, field.object)) return;
  v.Integer("address", field.address, 0, 65535, Need::kRequired);
  v.Enum("space", field.space, kSpaces);
  v.Enum("type", field.type, kCountTypes);
}

void CountTable(FieldVisitor& v, std::string_view key, RegisterField& field) {
  v.Table(key, Need::kRequired, [&](FieldVisitor& t) { VisitCount(t, field); });
}

void VisitText(FieldVisitor& v, hal::TextField& field) {
  if (!VisitObject(v, field.object)) {
    v.Integer("address", field.address, 0, 65535, Need::kRequired);
    v.Enum("space", field.space, kSpaces);
  }
  v.Integer("characters", field.characters, 1, 64);
}

// What the PLC reads of the cell, and says to it: every field may be left out.
void VisitReport(FieldVisitor& v, hal::ReportFields& report) {
  for (const auto& [key, field] : FieldsOf(report))
    v.OptionalTable<RegisterField>(key, *field, VisitCount);
  v.OptionalTable<hal::TextField>("identity", report.identity, VisitText);
}

void VisitOrders(FieldVisitor& v, hal::OrderFields& orders) {
  for (const auto& [key, field] : FieldsOf(orders))
    v.OptionalTable<RegisterField>(key, *field, VisitCount);
  v.OptionalTable<hal::TextField>("identity", orders.identity, VisitText);
}

// A length or an angle in a row; its address is relative to the row.
void VisitValue(FieldVisitor& v, RegisterField& field) {
  v.Integer("address", field.address, 0, 99, Need::kRequired);
  v.Enum("type", field.type, kValueTypes, Need::kRequired);
  v.Number("scale", field.scale, {-1e6, 1e6}, Need::kOptional);
  v.Number("offset", field.offset, {-1e6, 1e6}, Need::kOptional);
}

void ValueTable(FieldVisitor& v, std::string_view key, RegisterField& field) {
  v.Table(key, Need::kRequired, [&](FieldVisitor& t) { VisitValue(t, field); });
}

void VisitArea(FieldVisitor& v, hal::ProgramArea& area) {
  CountTable(v, "part_number", area.part_number);
  CountTable(v, "sequence", area.sequence);
  CountTable(v, "row_count", area.row_count);
  // A crc has the size that the algorithm gives it; the map says only where it stands.
  CountTable(v, "crc", area.crc);
  v.Table("rows", Need::kRequired, [&](FieldVisitor& t) {
    if (VisitObject(t, area.rows_object)) return;
    t.Integer("address", area.rows_address, 0, 65535, Need::kRequired);
    t.Enum("space", area.rows_space, kSpaces);
  });
}

}  // namespace

void VisitRegisterMap(FieldVisitor& v, hal::RegisterMap& map) {
  v.Text("name", map.name, Need::kRequired);
  v.Table("words", Need::kOptional, [&](FieldVisitor& t) {
    t.Bool("high_word_first", map.high_word_first);
    t.Bool("high_byte_first", map.high_byte_first);
    t.Integer("max_read_registers", map.max_read_registers, 2, 125);
    t.Integer("max_write_registers", map.max_write_registers, 2, 123);
  });
  v.Table("state", Need::kRequired, [&](FieldVisitor& t) {
    t.Table("mode", Need::kRequired, [&](FieldVisitor& m) {
      VisitCount(m, map.mode);
      m.Integer("not_ready", map.mode_not_ready, 0, 0xffffffff);
      m.Integer("idle", map.mode_idle, 0, 0xffffffff);
      m.Integer("bending", map.mode_bending, 0, 0xffffffff);
      m.Integer("fault", map.mode_fault, 0, 0xffffffff);
    });
    t.OptionalTable<RegisterField>("fault_code", map.fault_code, VisitCount);
    t.OptionalTable<RegisterField>("heartbeat", map.heartbeat, VisitCount);
    t.OptionalTable<RegisterField>("parts_bent", map.parts_bent, VisitCount);
  });
  v.Table("commit", Need::kRequired, [&](FieldVisitor& t) {
    t.OptionalTable<RegisterField>("sequence", map.commit, VisitCount);
    CountTable(t, "reply_sequence", map.reply_sequence);
    t.Table("reply", Need::kRequired, [&](FieldVisitor& r) {
      VisitCount(r, map.reply);
      r.Integer("accepted", map.reply_accepted, 1, 0xffffffff);
      r.Integer("rejected", map.reply_rejected, 1, 0xffffffff);
    });
    t.OptionalTable<RegisterField>("reply_code", map.reply_code, VisitCount);
  });
  v.Table("report", Need::kOptional, [&](FieldVisitor& t) { VisitReport(t, map.report); });
  v.Table("orders", Need::kOptional, [&](FieldVisitor& t) { VisitOrders(t, map.orders); });
  v.Table("active", Need::kRequired, [&](FieldVisitor& t) { VisitArea(t, map.active); });
  v.Table("staging", Need::kRequired, [&](FieldVisitor& t) { VisitArea(t, map.staging); });
  v.Table("row", Need::kRequired, [&](FieldVisitor& t) {
    t.Integer("max_rows", map.max_rows, 2, 1000, Need::kRequired);
    t.Integer("stride", map.row_stride, 3, 100, Need::kRequired);
    ValueTable(t, "length_mm", map.row_length_mm);
    ValueTable(t, "rotation_deg", map.row_rotation_deg);
    ValueTable(t, "angle_deg", map.row_angle_deg);
    t.OptionalTable<RegisterField>("bend_radius_mm", map.row_bend_radius_mm, VisitValue);
  });
  v.Table("conventions", Need::kOptional, [&](FieldVisitor& t) {
    t.Bool("rotation_sign_reversed", map.rotation_sign_reversed);
    t.Bool("rotation_cumulative", map.rotation_cumulative);
    t.Bool("length_cumulative", map.length_cumulative);
  });
}

}  // namespace bendloop::config
