// SPDX-License-Identifier: Apache-2.0
//
// Bad commits, each wrong in one thing only, so that a rule that is broken is the one that is
// blamed.
#include <functional>

#include "drivers/register_bender/field_codec.h"
#include "firmware-host/acceptance/scripts.h"

namespace bendloop::host {
namespace {

// A commit that is wrong in every way: the last one that was answered is not the active one then.
void CommitNonsense(Bench& bench) {
  RegisterProgram program = bench.Fresh();
  program.crc ^= 1;
  program.row_count = 0;
  if (!bench.plc().Stage(program)) return;
  bench.CommitAndWait(bench.FreshSequence());
  if (const auto active = bench.plc().Active()) bench.Adopt(*active);
}

// Stages a good program and commits what `number` makes of its sequence.
void PlayNumber(Bench& bench, const std::string& name,
                const std::function<std::uint32_t(const RegisterProgram&)>& number) {
  bench.Run("commit " + name, [&] {
    CommitNonsense(bench);
    bench.LeaveGap();
    const RegisterProgram program = bench.Fresh();
    const std::uint32_t commit = number(program);
    if (commit == 0 || commit == program.sequence || commit > bench.plc().max_sequence()) {
      return bench.LeaveOut("the registers do not hold such a number");
    }
    if (bench.StageAndCompare(program)) {
      bench.ExpectRejected(Rule::kStagedNumber, commit, program);
    }
  });
}

void PlayNumbers(Bench& bench) {
  using Program = RegisterProgram;
  PlayNumber(bench, "the staged sequence + 1", [](const Program& p) { return p.sequence + 1; });
  PlayNumber(bench, "the staged sequence - 1", [](const Program& p) { return p.sequence - 1; });
  for (const int bit : {4, 8, 15, 16, 24, 31}) {
    PlayNumber(bench, "the staged sequence with bit " + std::to_string(bit) + " flipped",
               [bit](const Program& p) { return p.sequence ^ 1u << bit; });
  }
  PlayNumber(bench, "the staged sequence with its words swapped",
             [](const Program& p) { return p.sequence << 16 | p.sequence >> 16; });
  PlayNumber(bench, "the largest number",
             [&](const Program&) { return bench.plc().max_sequence(); });
  PlayNumber(bench, "the active sequence instead of the staged one",
             [&](const Program&) { return bench.active().sequence; });
  PlayNumber(bench, "the number of a program that was staged before", [&](const Program&) {
    const Program stale = bench.Fresh();
    bench.StageAndCompare(stale);
    return stale.sequence;
  });
  bench.Run("commit with the staged sequence 0", [&] {
    Program program = bench.Fresh();
    const std::uint32_t number = program.sequence;
    program.sequence = 0;
    bench.Sign(program);
    if (bench.StageAndCompare(program)) {
      bench.ExpectRejected(Rule::kStagedNumber, number, program);
    }
  });
}

void PlayActiveNumber(Bench& bench, const std::string& name, bool same_rows) {
  bench.Run("commit the active sequence again, " + name, [&] {
    CommitNonsense(bench);
    if (bench.active().sequence == 0) return bench.LeaveOut("the active program has none");
    RegisterProgram program = same_rows ? bench.active() : bench.Fresh();
    program.sequence = bench.active().sequence;
    bench.Sign(program);
    bench.StageAndExpectRejected(Rule::kActiveNumber, program);
  });
}

void PlayRowCounts(Bench& bench) {
  const std::uint32_t most = drivers::MaxInteger(bench.plc().map().staging.row_count);
  const std::uint32_t rows = bench.plc().map().max_rows;
  for (const std::uint32_t count : {0u, 1u, rows + 1, 2 * rows, most}) {
    if (count > most) continue;
    bench.Run("commit a row count of " + std::to_string(count), [&] {
      RegisterProgram program = bench.Fresh();
      // One row is its end, so that nothing else is wrong with it.
      const auto stride = static_cast<std::ptrdiff_t>(bench.plc().form().stride());
      if (count == 1) program.words.assign(program.words.end() - stride, program.words.end());
      program.row_count = count;
      bench.Sign(program);
      bench.StageAndExpectRejected(Rule::kRowCount, program);
    });
  }
}

void PlayCrc(Bench& bench, const std::string& name,
             const std::function<void(RegisterProgram&)>& damage) {
  bench.Run("commit with " + name, [&] {
    RegisterProgram program = bench.Fresh();
    const RegisterProgram good = program;
    damage(program);
    if (program == good) return bench.LeaveOut("it changes nothing in this program");
    bench.StageAndExpectRejected(Rule::kCrc, program);
  });
}

void PlayCrcs(Bench& bench) {
  using Program = RegisterProgram;
  for (const int bit : {0, 7, 8, 15, 16, 23, 24, 31}) {
    PlayCrc(bench, "bit " + std::to_string(bit) + " of the crc flipped",
            [bit](Program& p) { p.crc ^= 1u << bit; });
  }
  PlayCrc(bench, "crc 0", [](Program& p) { p.crc = 0; });
  PlayCrc(bench, "crc 0xffffffff", [](Program& p) { p.crc = 0xffffffff; });
  PlayCrc(bench, "the crc inverted", [](Program& p) { p.crc = ~p.crc; });
  PlayCrc(bench, "the crc's words swapped", [](Program& p) { p.crc = p.crc << 16 | p.crc >> 16; });
  PlayCrc(bench, "the active program's crc", [&](Program& p) { p.crc = bench.active().crc; });
  PlayCrc(bench, "the crc of the sequence before", [&](Program& p) {
    --p.sequence;
    bench.Sign(p);
    ++p.sequence;
  });
  PlayCrc(bench, "the crc of one row less", [&](Program& p) {
    --p.row_count;
    bench.Sign(p);
    ++p.row_count;
  });
  for (const auto& named : bench.plc().form().row_fields()) {
    for (const bool last : {false, true}) {
      // An end with an angle, or a turn, would be wrong in another thing, too.
      if (last && std::string(named.name) != "length_mm") continue;
      PlayCrc(bench,
              std::string("a bit of ") + named.name + (last ? " of the end" : "") + " flipped",
              [&](Program& p) {
                ProgramForm& form = bench.plc().form();
                const std::size_t row = last ? p.row_count - 1 : 0;
                form.SetBits(p, row, named.field, form.Bits(p, row, named.field) ^ 2);
              });
    }
  }
}

// A write that was cut: some rows are the new program's, the others what was staged before.
void PlayTorn(Bench& bench, const std::string& name, std::size_t first, std::size_t count,
              bool head) {
  bench.Run("commit after a torn write: " + name, [&] {
    Plc& plc = bench.plc();
    if (plc.map().of_objects() && first != 0) return bench.LeaveOut("the rows are one object");
    // Every row with a bend differs, and so does the end: half of each is no program of ours.
    const RegisterProgram before = bench.Fresh();
    const RegisterProgram program = bench.Fresh();
    if (!bench.StageAndCompare(before)) return;
    if (count > 0 && !plc.StageRows(program, first, count)) return;
    if (head && !plc.StageHead(program)) return;
    bench.ExpectRejected(head ? Rule::kCrc : Rule::kStagedNumber, program.sequence, program);
  });
}

void PlayTornWrites(Bench& bench) {
  const std::size_t rows = bench.active().row_count;
  PlayTorn(bench, "the head alone", 0, 0, true);
  PlayTorn(bench, "head and first row", 0, 1, true);
  PlayTorn(bench, "head and all rows but the last", 0, rows - 1, true);
  PlayTorn(bench, "head and last row", rows - 1, 1, true);
  PlayTorn(bench, "head and second half", rows / 2, rows - rows / 2, true);
  PlayTorn(bench, "the rows without the head", 0, rows, false);
}

void PlayLimit(Bench& bench, const std::string& name,
               const std::function<void(hal::BendProgram&)>& spoil) {
  bench.Run("commit " + name, [&] {
    const auto good = bench.plc().form().ToBlock(bench.Fresh());
    if (!good) return;
    hal::ProgramBlock block = *good;
    spoil(block.program);
    const auto program = bench.plc().form().FromBlock(block);
    if (!program) return bench.LeaveOut("the registers do not hold such a value");
    bench.StageAndExpectRejected(Rule::kLimits, *program);
  });
}

void PlayLimits(Bench& bench) {
  using Program = hal::BendProgram;
  PlayLimit(bench, "a length of -1 mm", [](Program& p) { p.rows.front().length_mm = -1; });
  PlayLimit(bench, "a length of -100 mm in the second row",
            [](Program& p) { p.rows[1].length_mm = -100; });
  PlayLimit(bench, "an end length of -1 mm", [](Program& p) { p.rows.back().length_mm = -1; });
  PlayLimit(bench, "an angle of -1 degree", [](Program& p) { p.rows.front().angle_deg = -1; });
  PlayLimit(bench, "an angle of 360 degrees", [](Program& p) { p.rows.front().angle_deg = 360; });
  PlayLimit(bench, "an angle of 1000 degrees", [](Program& p) { p.rows.front().angle_deg = 1000; });
  PlayLimit(bench, "an end with an angle", [](Program& p) { p.rows.back().angle_deg = 10; });
}

void PlayParts(Bench& bench) {
  const std::uint32_t most = drivers::MaxInteger(bench.plc().map().staging.part_number);
  for (const std::uint32_t bits : {0x1u, 0x100u, 0x10000u, 0x1000000u}) {
    bench.Run("commit a part number that differs in bit mask " + std::to_string(bits), [&] {
      RegisterProgram program = bench.Fresh();
      program.part_number ^= bits;
      if (program.part_number > most) return bench.LeaveOut("the register does not hold it");
      bench.Sign(program);
      bench.StageAndExpectRejected(Rule::kPart, program);
    });
  }
}

}  // namespace

void PlayRejections(Bench& bench) {
  PlayCrcs(bench);
  PlayTornWrites(bench);
  PlayNumbers(bench);
  PlayActiveNumber(bench, "with other rows", false);
  PlayActiveNumber(bench, "with the same rows", true);
  PlayRowCounts(bench);
  PlayLimits(bench);
  PlayParts(bench);
  bench.Run("commit a good program after the bad ones", [&] {
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
  bench.Run("commit the same bad program twice", [&] {
    RegisterProgram program = bench.Fresh();
    program.crc ^= 1;
    bench.StageAndExpectRejected(Rule::kCrc, program);
    if (!bench.is_last_rejected() || !bench.plc().Commit(program.sequence)) return;
    bench.ExpectQuiet("a rejected commit, once more,");
  });
  bench.Run("nothing comes late after a rejection", [&] {
    if (!bench.is_last_rejected()) return bench.LeaveOut("the last commit was not rejected");
    bench.ExpectQuiet("a rejected commit, late,", bench.options().late);
  });
}

}  // namespace bendloop::host
