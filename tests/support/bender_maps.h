// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <random>
#include <string>

#include "hal/bend_program.h"
#include "hal/register_map.h"

namespace bendloop::test {

inline hal::RegisterField Field(int address, hal::RegisterType type, double scale = 1,
                                hal::RegisterSpace space = hal::RegisterSpace::kHolding) {
  return {static_cast<std::uint16_t>(address), space, type, scale, 0};
}

// Plain: holding registers, uint32 and int32, high word first, relative rows with a bend radius.
inline hal::RegisterMap PlainMap() {
  using T = hal::RegisterType;
  hal::RegisterMap map;
  map.name = "plain";
  map.max_rows = 40;
  map.mode = Field(0, T::kUint16);
  map.fault_code = Field(1, T::kUint16);
  map.heartbeat = Field(2, T::kUint16);
  map.reply = Field(3, T::kUint16);
  map.reply_code = Field(4, T::kUint16);
  map.reply_sequence = Field(5, T::kUint32);
  map.parts_bent = Field(7, T::kUint32);
  map.active = {Field(100, T::kUint32),
                Field(102, T::kUint32),
                Field(104, T::kUint16),
                Field(105, T::kUint32),
                110,
                hal::RegisterSpace::kHolding};
  map.staging = {Field(1000, T::kUint32),
                 Field(1002, T::kUint32),
                 Field(1004, T::kUint16),
                 Field(1005, T::kUint32),
                 1010,
                 hal::RegisterSpace::kHolding};
  map.commit = Field(2000, T::kUint32);
  map.report = {.heartbeat = Field(3000, T::kUint16),
                .state = Field(3001, T::kUint16),
                .alarm = Field(3002, T::kUint16),
                .alarms = {},
                .sequence = Field(3004, T::kUint32),
                .verdict = Field(3006, T::kUint16),
                .part_number = Field(3008, T::kUint32),
                .worst_percent = Field(3010, T::kUint16),
                .identity = hal::TextField{3020, hal::RegisterSpace::kHolding, 32, {}},
                .tubes = Field(3011, T::kUint32),
                .passed = {},
                .failed = {},
                .undecided = {},
                .held = {},
                .part_set = {},
                .acknowledged = Field(3013, T::kUint16),
                .lot_begun = {}};
  map.orders = {.part_number = Field(40, T::kUint32),
                .scan = Field(42, T::kUint16),
                .hold = Field(43, T::kUint16),
                .new_lot = {},
                .acknowledge = Field(44, T::kUint16),
                .identity = hal::TextField{45, hal::RegisterSpace::kHolding, 31, {}}};
  map.row_stride = 8;
  map.row_length_mm = Field(0, T::kInt32, 0.001);
  map.row_rotation_deg = Field(2, T::kInt32, 0.001);
  map.row_angle_deg = Field(4, T::kInt32, 0.001);
  map.row_bend_radius_mm = Field(6, T::kUint32, 0.001);
  return map;
}

// Odd in every way: inputs and holdings, low word first, floats beside 16-bit values, a cumulative
// reversed rotation, feed positions, no radius, gaps, small requests, other mode numbers.
inline hal::RegisterMap OddMap() {
  using T = hal::RegisterType;
  constexpr auto kInput = hal::RegisterSpace::kInput;
  hal::RegisterMap map;
  map.name = "odd";
  map.high_word_first = false;
  map.max_rows = 25;
  map.max_read_registers = 20;
  map.max_write_registers = 16;
  map.mode = Field(7, T::kInt16, 1, kInput);
  map.mode_not_ready = 10;
  map.mode_idle = 20;
  map.mode_bending = 30;
  map.mode_fault = 40;
  map.heartbeat = Field(9, T::kUint32, 1, kInput);
  map.reply_sequence = Field(30, T::kUint16, 1, kInput);
  map.reply = Field(31, T::kUint16, 1, kInput);
  map.reply_accepted = 7;
  map.reply_rejected = 9;
  map.active = {Field(100, T::kUint16, 1, kInput),
                Field(101, T::kUint16, 1, kInput),
                Field(102, T::kUint16, 1, kInput),
                Field(104, T::kUint32, 1, kInput),
                200,
                kInput};
  map.staging = {Field(500, T::kUint16),
                 Field(501, T::kUint16),
                 Field(502, T::kUint16),
                 Field(504, T::kUint32),
                 600,
                 hal::RegisterSpace::kHolding};
  map.commit = Field(510, T::kUint16);
  map.row_stride = 5;
  map.row_angle_deg = Field(0, T::kInt16, 0.01);
  map.row_rotation_deg = Field(1, T::kUint16, 0.01);
  map.row_length_mm = Field(3, T::kFloat32);
  map.rotation_sign_reversed = true;
  map.rotation_cumulative = true;
  map.length_cumulative = true;
  return map;
}

// The open PLC of the bad old days: what is written is what it bends; no commit register.
inline hal::RegisterMap NoCommitMap() {
  hal::RegisterMap map = PlainMap();
  map.name = "no_commit";
  map.commit.reset();
  map.staging = map.active;
  return map;
}

// A program that fits both maps: `bends` bends of 1 to 170 degrees.
inline hal::BendProgram RandomProgram(std::mt19937_64& random, int bends) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  hal::BendProgram program;
  for (int i = 0; i < bends; ++i) {
    program.rows.push_back(
        {uniform(0, 300), i == 0 ? 0.0 : uniform(-180, 180), uniform(1, 170), uniform(10, 100)});
  }
  program.rows.push_back({uniform(5, 300), 0, 0, {}});
  return program;
}

}  // namespace bendloop::test
