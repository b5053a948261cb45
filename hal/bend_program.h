// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace bendloop::hal {

// One row of an LRA program: feed, rotate, bend.
struct BendRow {
  double length_mm = 0;                  // straight before the bend, tangent point to tangent point
  double rotation_deg = 0;               // of the bend plane about the feed, (-180, 180]
  double angle_deg = 0;                  // bend angle; may exceed 180
  std::optional<double> bend_radius_mm;  // CLR; empty in the last row, which has no bend

  bool operator==(const BendRow&) const = default;
};

// A tube as the bender makes it: n bends are n + 1 rows, the last with angle 0 is the end length.
// Rotation: N = t_in x t_out is a bend's normal; the rotation is the angle from the previous N to
// this N, right-handed about the feed direction; the first is 0 by convention.
struct BendProgram {
  std::vector<BendRow> rows;

  std::size_t bend_count() const { return rows.empty() ? 0 : rows.size() - 1; }
  bool operator==(const BendProgram&) const = default;
};

// A program with what identifies it on the bender.
struct ProgramBlock {
  std::uint32_t part_number = 0;  // which part the program makes
  std::uint32_t sequence = 0;     // set by us, one more at each program sent; 0: never set
  BendProgram program;
  std::uint32_t crc = 0;  // over the encoded rows, as the link's map defines it

  bool operator==(const ProgramBlock&) const = default;
};

// Rotation brought into (-180, 180].
double WrapRotationDeg(double rotation_deg);

}  // namespace bendloop::hal
