// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>

namespace bendloop::hal {

enum class RegisterSpace : std::uint8_t { kHolding, kInput };  // FC 3/6/16, FC 4
// kUint8: half a register, only as a CANopen object.
enum class RegisterType : std::uint8_t { kUint16, kInt16, kUint32, kInt32, kFloat32, kUint8 };

constexpr std::uint16_t RegisterCount(RegisterType type) {
  return type == RegisterType::kUint32 || type == RegisterType::kInt32 ||
                 type == RegisterType::kFloat32
             ? 2
             : 1;
}

// What a register of the type holds, before scale and offset: whole numbers, but for kFloat32.
struct RawRange {
  double min;
  double max;
};
constexpr RawRange RawRangeOf(RegisterType type) {
  switch (type) {
    case RegisterType::kUint16:
      return {0, 65535};
    case RegisterType::kInt16:
      return {-32768, 32767};
    case RegisterType::kUint32:
      return {0, 4294967295.0};
    case RegisterType::kInt32:
      return {-2147483648.0, 2147483647.0};
    case RegisterType::kUint8:
      return {0, 255};
    case RegisterType::kFloat32:
      break;
  }
  constexpr double kMaxFloat = std::numeric_limits<float>::max();
  return {-kMaxFloat, kMaxFloat};
}

// An entry of a CANopen object dictionary; index 0: none.
struct ObjectAddress {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;

  bool operator==(const ObjectAddress&) const = default;
};

// "2001sub3", as a section of an EDS file names it.
std::string Name(ObjectAddress object);

// One value in a controller: value = raw * scale + offset.
struct RegisterField {
  std::uint16_t address = 0;  // zero-based, as on the wire; inside a row: relative to the row
  RegisterSpace space = RegisterSpace::kHolding;
  RegisterType type = RegisterType::kUint16;
  double scale = 1;
  double offset = 0;
  ObjectAddress object = {};  // in a map of objects; `address` is then only where the link keeps it
};

// Where a whole program stands: a head and `max_rows` rows, `row_stride` registers apart.
struct ProgramArea {
  RegisterField part_number;
  RegisterField sequence;
  RegisterField row_count;  // rows including the end length
  RegisterField crc;        // uint32
  std::uint16_t rows_address = 0;
  RegisterSpace rows_space = RegisterSpace::kHolding;
  ObjectAddress rows_object = {};  // DOMAIN: the rows one after the other
};

// Text in a controller: two characters a register, the first one in the byte that comes first;
// unused ones are 0.
struct TextField {
  std::uint16_t address = 0;
  RegisterSpace space = RegisterSpace::kHolding;
  std::uint16_t characters = 32;
  ObjectAddress object = {};  // DOMAIN or a string, of `characters` bytes

  constexpr std::uint16_t registers() const {
    return static_cast<std::uint16_t>((characters + 1) / 2);
  }
};

// Where the PLC reads what it wants to know of the cell (CellReport); written by us.
struct ReportFields {
  std::optional<RegisterField> heartbeat, state, alarm, alarms;
  std::optional<RegisterField> sequence, verdict, part_number, worst_percent;
  std::optional<TextField> identity;
  std::optional<RegisterField> tubes, passed, failed, undecided, held;
  std::optional<RegisterField> part_set, acknowledged, lot_begun;
};

// Where the PLC says what it wants of the cell (PlcOrders); read by us.
struct OrderFields {
  std::optional<RegisterField> part_number, scan, hold, new_lot, acknowledge;
  std::optional<TextField> identity;
};

// How a PLC shows a bender: read from a register-map file, so that no code knows an address. Either
// all fields are registers, or all are objects of a CANopen dictionary; these are kept in registers
// of their own, low byte and low word first.
struct RegisterMap {
  std::string name;
  bool high_word_first = true;  // of 32-bit values
  bool high_byte_first = true;  // within a register; Modbus says true
  std::uint16_t max_rows = 0;
  std::uint16_t max_read_registers = 125;
  std::uint16_t max_write_registers = 123;

  // State, read in as few requests as the addresses allow.
  RegisterField mode;
  std::uint32_t mode_not_ready = 0;  // what `mode` reads in each BenderMode
  std::uint32_t mode_idle = 1;
  std::uint32_t mode_bending = 2;
  std::uint32_t mode_fault = 3;
  std::optional<RegisterField> fault_code;
  std::optional<RegisterField> heartbeat;
  std::optional<RegisterField> parts_bent;

  // Handshake: we write the staged sequence to `commit`; the bender copies it to `reply_sequence`
  // and says in `reply` what it did.
  std::optional<RegisterField> commit;  // empty: no commit register, weaker guarantee
  RegisterField reply_sequence;
  RegisterField reply;
  std::uint32_t reply_accepted = 1;
  std::uint32_t reply_rejected = 2;
  std::optional<RegisterField> reply_code;

  ReportFields report;
  OrderFields orders;

  ProgramArea active;
  ProgramArea staging;
  std::uint16_t row_stride = 0;
  RegisterField row_length_mm;  // addresses relative to the row
  RegisterField row_rotation_deg;
  RegisterField row_angle_deg;
  std::optional<RegisterField> row_bend_radius_mm;

  // The controller's conventions, ours on the left of the arrow in config/README.md.
  bool rotation_sign_reversed = false;
  bool rotation_cumulative = false;  // absolute 0..360 instead of relative
  bool length_cumulative = false;    // feed position instead of straight length

  bool of_objects() const { return mode.object.index != 0; }
};

}  // namespace bendloop::hal
