// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/bend_program.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::host {

// A program as it stands in registers, a good one or not.
struct RegisterProgram {
  std::uint32_t part_number = 0;
  std::uint32_t sequence = 0;
  std::uint32_t row_count = 0;  // as the register says it, whatever `words` has
  std::uint32_t crc = 0;
  std::vector<std::uint16_t> words;  // rows one after the other; what no field uses is 0

  bool operator==(const RegisterProgram&) const = default;
};

// The same head; the rows are not looked at.
bool SameHead(const RegisterProgram& a, const RegisterProgram& b);

// In which value two programs differ first, "row 2 angle_deg: holds 0000 2f44, expected 0000
// 2f40"; empty: in none.
std::string Difference(const hal::RegisterMap& map, const RegisterProgram& found,
                       const RegisterProgram& expected);

// A program between registers and RegisterProgram, by the map. Keeps a reference to it.
class ProgramForm {
 public:
  explicit ProgramForm(const hal::RegisterMap& map);

  // As the driver would stage it, with its crc. kBadInput if a value does not fit.
  hal::Result<RegisterProgram> FromBlock(const hal::ProgramBlock& block);
  // kDevice if what stands there is no program.
  hal::Result<hal::ProgramBlock> ToBlock(const RegisterProgram& program);
  std::uint32_t Crc(const RegisterProgram& program);
  // Into the registers of an area. kBadInput if a value of the head does not fit its register.
  hal::Result<void> Put(const RegisterProgram& program, const hal::ProgramArea& area,
                        drivers::RegisterImage& image) const;
  // The head and `rows` rows. kDevice if a register of the head holds no number.
  hal::Result<RegisterProgram> Take(const hal::ProgramArea& area, std::size_t rows,
                                    const drivers::RegisterImage& image) const;
  // The bits of one value of a row, whatever they mean.
  void SetBits(RegisterProgram& program, std::size_t row, const hal::RegisterField& field,
               std::uint32_t bits) const;
  std::uint32_t Bits(const RegisterProgram& program, std::size_t row,
                     const hal::RegisterField& field) const;

  struct NamedField {
    hal::RegisterField field;  // address within the row
    const char* name;
  };
  const std::vector<NamedField>& row_fields() const { return fields_; }
  std::size_t stride() const { return map_.row_stride; }

 private:
  std::uint16_t OnWire(std::uint16_t word) const;  // and back: the map's byte order

  const hal::RegisterMap& map_;
  std::vector<NamedField> fields_;
  std::vector<bool> used_;  // registers of a row
  drivers::RegisterImage scratch_;
};

}  // namespace bendloop::host
