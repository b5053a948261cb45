// SPDX-License-Identifier: Apache-2.0
#include "config/digest.h"

#include <cstdint>

#include "config/fields.h"
#include "config/text_writer.h"

namespace bendloop::config {

std::string EffectiveText(const CellConfig& cell) {
  TextWriter writer({"part",
                     "state_dir",
                     "scanner",
                     "record",
                     "storage",
                     "log",
                     "realtime",
                     "bender.host",
                     "bender.port",
                     "bender.device",
                     "bender.baud",
                     "bender.parity",
                     "bender.stop_bits",
                     "bender.rs485",
                     "bender.rs485_delay_before_send_ms",
                     "bender.rs485_delay_after_send_ms",
                     "bender.can_interface",
                     "bender.can_request_id",
                     "bender.can_reply_id",
                     "bender.can_node_id",
                     "bender.object_dictionary",
                     "bender.heartbeat_timeout_ms",
                     "bender.unit_id",
                     "bender.register_map",
                     "bender.connect_timeout_ms",
                     "bender.response_timeout_ms",
                     "bender.byte_timeout_ms",
                     "bender.commit_timeout_ms",
                     "bender.allow_non_atomic",
                     "parts_dir",
                     "register_map_file.report",
                     "register_map_file.orders"});
  CellConfig copy = cell;  // visitors may change what they visit; this one does not
  VisitCell(writer, copy);
  writer.Table("part_file", Need::kRequired, [&](FieldVisitor& v) { VisitPart(v, copy.part); });
  if (copy.bender.link != BenderKind::kNone) {
    writer.Table("register_map_file", Need::kRequired,
                 [&](FieldVisitor& v) { VisitRegisterMap(v, copy.bender.register_map); });
  }
  return writer.text();
}

namespace {

std::string Fnv1a(const std::string& effective) {
  static constexpr char kHex[] = "0123456789abcdef";
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char c : effective) {
    hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
  }
  std::string text(16, '0');
  for (std::size_t i = 0; i < 16; ++i) text[i] = kHex[hash >> (60 - 4 * i) & 15];
  return text;
}

}  // namespace

std::string Digest(const CellConfig& cell) { return Fnv1a(EffectiveText(cell)); }

std::string Digest(const hal::RegisterMap& map) {
  TextWriter writer;
  hal::RegisterMap copy = map;
  VisitRegisterMap(writer, copy);
  return Fnv1a(writer.text());
}

}  // namespace bendloop::config
