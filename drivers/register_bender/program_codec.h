// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/bend_program.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// kBadInput if no program can be carried by the map: a row larger than its stride, areas beyond
// register 65535, a crc that is not uint32, a scale of 0, request sizes that Modbus forbids.
hal::Result<void> CheckRegisterMap(const hal::RegisterMap& map);

// Writes head, crc and rows of `block` (its crc member is ignored) into `area`; registers of a row
// that no field uses become 0. kBadInput, naming row and value, if something does not fit; the
// image is then partly written. Bend radii are dropped if the map has no register for them.
hal::Result<void> EncodeProgram(const hal::RegisterMap& map, const hal::ProgramArea& area,
                                const hal::ProgramBlock& block, RegisterImage& image);

// Reads head and rows as they stand, the crc register included and unchecked. kDevice if the row
// count is larger than the map's max_rows or a value is not a number.
hal::Result<hal::ProgramBlock> DecodeProgram(const hal::RegisterMap& map,
                                             const hal::ProgramArea& area,
                                             const RegisterImage& image);

// CRC-32 (IEEE 802.3, as zlib's crc32) over part number, sequence and row count as three 32-bit
// big-endian numbers, then row_count * row_stride row registers, each as its two bytes on the wire,
// with registers that no field uses as 0. row_count <= map.max_rows.
std::uint32_t ProgramCrc(const hal::RegisterMap& map, const hal::ProgramArea& area,
                         std::uint32_t part_number, std::uint32_t sequence, std::uint32_t row_count,
                         const RegisterImage& image);

// The registers of `rows` rows.
RegisterRange RowsRange(const hal::RegisterMap& map, const hal::ProgramArea& area,
                        std::size_t rows);

// Part number, sequence, row count and crc.
std::vector<RegisterRange> HeadRanges(const hal::ProgramArea& area);

// Ranges that touch or overlap joined, then split into requests of at most `max_count` registers,
// in the order of space and address. Gaps are never read: a PLC may refuse them.
std::vector<RegisterRange> PlanRequests(std::vector<RegisterRange> ranges, std::uint16_t max_count);

}  // namespace bendloop::drivers
