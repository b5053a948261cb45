// SPDX-License-Identifier: Apache-2.0
//
// Staging only stores (R3) and moves nothing (R4): every field through its range, bits that show a
// swapped word or byte, every order of writing. Nothing is committed here.
#include <bit>
#include <cstdio>

#include "drivers/register_bender/field_codec.h"
#include "firmware-host/acceptance/scripts.h"

namespace bendloop::host {
namespace {

using hal::RegisterType;

std::string AllDigits(std::uint32_t value) {
  char text[16];
  std::snprintf(text, sizeof text, "%08x", value);
  return text;
}

// Bits that show words or bytes that change places, signs that are lost, and both ends of a range.
std::vector<std::uint32_t> PatternsOf(const hal::RegisterField& field) {
  switch (field.type) {
    case RegisterType::kFloat32: {
      std::vector<std::uint32_t> patterns;
      for (const float value : {0.0F, 0.1F, -0.1F, 123.456F, -179.999F, 1e-6F, 16777215.0F}) {
        patterns.push_back(std::bit_cast<std::uint32_t>(value));
      }
      return patterns;
    }
    case RegisterType::kUint32:
    case RegisterType::kInt32:
      return {0, 1, 0x00012345, 0x12345678, 0x7fffffff, 0x80000000, 0xffffffff};
    case RegisterType::kUint16:
    case RegisterType::kInt16:
    case RegisterType::kUint8:
      break;
  }
  return {0, 1, 0x0123, 0x1234, 0x7fff, 0x8000, 0xffff};
}

// A program of `rows` rows: the found one's, over and over, and an end.
RegisterProgram Long(Bench& bench, std::size_t rows) {
  RegisterProgram program = bench.Fresh();
  const std::size_t stride = bench.plc().form().stride();
  const std::vector<std::uint16_t> base = program.words;
  while (program.words.size() < rows * stride) {
    program.words.push_back(base[program.words.size() % (base.size() - stride)]);
  }
  program.row_count = static_cast<std::uint32_t>(rows);
  bench.Sign(program);
  return program;
}

void PlayRowField(Bench& bench, const ProgramForm::NamedField& named) {
  for (const std::uint32_t bits : PatternsOf(named.field)) {
    bench.Run(std::string("stage ") + named.name + " as " + AllDigits(bits), [&] {
      RegisterProgram program = bench.Fresh();
      bench.plc().form().SetBits(program, 0, named.field, bits);
      bench.Sign(program);
      bench.StageAndCompare(program);
    });
  }
}

void PlayLastRow(Bench& bench, const ProgramForm::NamedField& named) {
  bench.Run(std::string("stage ") + named.name + " of the last row that fits", [&] {
    RegisterProgram program = Long(bench, bench.plc().map().max_rows);
    const std::uint32_t bits = PatternsOf(named.field)[3];
    bench.plc().form().SetBits(program, program.row_count - 1, named.field, bits);
    bench.Sign(program);
    bench.StageAndCompare(program);
  });
}

void PlayHeadField(Bench& bench, const char* name, const hal::RegisterField& field,
                   std::uint32_t RegisterProgram::*member) {
  const std::uint32_t most = drivers::MaxInteger(field);
  for (const std::uint32_t value : {std::uint32_t{0}, std::uint32_t{1}, std::uint32_t{0x1234},
                                    std::uint32_t{0x12345678}, most}) {
    if (value > most) continue;
    bench.Run(std::string("stage ") + name + " as " + AllDigits(value), [&] {
      RegisterProgram program = bench.Fresh();
      program.*member = value;
      bench.StageAndCompare(program);
    });
  }
}

void PlayOrdersOfWriting(Bench& bench) {
  Plc& plc = bench.plc();
  bench.Run("stage the head before the rows", [&] {
    const RegisterProgram program = bench.Fresh();
    if (plc.StageHead(program) && plc.StageRows(program, 0, program.row_count)) {
      bench.CompareStaged(program);
    }
  });
  bench.Run("stage the head value by value, the last one first", [&] {
    const RegisterProgram program = bench.Fresh();
    if (plc.StageRows(program, 0, program.row_count) && plc.StageHeadOneByOne(program)) {
      bench.CompareStaged(program);
    }
  });
  bench.Run("stage row by row, the last one first", [&] {
    if (plc.map().of_objects()) return bench.LeaveOut("the rows are one object");
    const RegisterProgram program = bench.Fresh();
    bool done = plc.StageHead(program);
    for (std::size_t row = program.row_count; done && row > 0; --row) {
      done = plc.StageRows(program, row - 1, 1);
    }
    if (done) bench.CompareStaged(program);
  });
  bench.Run("stage the same program twice", [&] {
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.StageAndCompare(program);
  });
  bench.Run("stage another program over a program", [&] {
    if (bench.StageAndCompare(bench.Fresh())) bench.StageAndCompare(bench.Fresh());
  });
  bench.Run("stage as many rows as fit",
            [&] { bench.StageAndCompare(Long(bench, plc.map().max_rows)); });
  bench.Run("stage two rows", [&] {
    RegisterProgram program = bench.Fresh();
    program.words.resize(2 * plc.form().stride());
    program.row_count = 2;
    bench.Sign(program);
    bench.StageAndCompare(program);
  });
  bench.Run("what is staged stays, and moves nothing", [&] {
    const RegisterProgram program = bench.Fresh();
    if (!bench.StageAndCompare(program)) return;
    bench.ExpectQuiet("a staged program");
    bench.CompareStaged(program);
  });
}

}  // namespace

void PlayStaging(Bench& bench) {
  const hal::ProgramArea& area = bench.plc().map().staging;
  PlayHeadField(bench, "part_number", area.part_number, &RegisterProgram::part_number);
  PlayHeadField(bench, "sequence", area.sequence, &RegisterProgram::sequence);
  PlayHeadField(bench, "row_count", area.row_count, &RegisterProgram::row_count);
  PlayHeadField(bench, "crc", area.crc, &RegisterProgram::crc);
  for (const auto& named : bench.plc().form().row_fields()) PlayRowField(bench, named);
  for (const auto& named : bench.plc().form().row_fields()) PlayLastRow(bench, named);
  PlayOrdersOfWriting(bench);
}

}  // namespace bendloop::host
