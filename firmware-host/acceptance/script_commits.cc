// SPDX-License-Identifier: Apache-2.0
//
// Good programs: each must become active (R12, R13), be used up (R14) and be answered (R16).
#include <cmath>

#include "firmware-host/acceptance/scripts.h"

namespace bendloop::host {
namespace {

// So far from the found program's own number that no exchange meets it.
constexpr std::uint32_t kRoom = 1000;

void Accept(Bench& bench, const std::string& name) {
  bench.Run(name, [&] {
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
}

// The last bit of one value, a thousandth of a unit in most maps: it must reach the active program.
void PlayFields(Bench& bench) {
  bench.Run("commit a changed end length", [&] {
    ProgramForm& form = bench.plc().form();
    RegisterProgram program = bench.Fresh();
    const hal::RegisterField& length = bench.plc().map().row_length_mm;
    const std::size_t end = program.row_count - 1;
    form.SetBits(program, end, length, form.Bits(program, end, length) ^ 1);
    bench.Sign(program);
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
  for (const auto& named : bench.plc().form().row_fields()) {
    bench.Run(std::string("commit a changed ") + named.name, [&] {
      ProgramForm& form = bench.plc().form();
      RegisterProgram program = bench.Fresh();
      // The first bend has no rotation.
      const std::size_t row = program.row_count > 2 ? 1 : 0;
      form.SetBits(program, row, named.field, form.Bits(program, row, named.field) ^ 1);
      bench.Sign(program);
      if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
    });
  }
}

void PlayOrders(Bench& bench) {
  Plc& plc = bench.plc();
  bench.Run("commit a program that was staged in pieces, the head first", [&] {
    const RegisterProgram program = bench.Fresh();
    const std::size_t half = program.row_count / 2;
    const bool objects = plc.map().of_objects();
    const bool staged = plc.StageHeadOneByOne(program) &&
                        (objects ? plc.StageRows(program, 0, program.row_count)
                                 : plc.StageRows(program, half, program.row_count - half) &&
                                       plc.StageRows(program, 0, half));
    if (staged && bench.CompareStaged(program)) bench.ExpectAccepted(program);
  });
  bench.Run("commit a program that was staged twice", [&] {
    const RegisterProgram program = bench.Fresh();
    if (plc.Stage(program) && bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
  bench.Run("commit the last of two staged programs", [&] {
    bench.StageAndCompare(bench.Fresh());
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
  bench.Run("commit the active rows once more, with another number", [&] {
    RegisterProgram program = bench.active();
    program.sequence = bench.FreshSequence();
    bench.Sign(program);
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
  bench.Run("commit the daemon's own way", [&] {
    const RegisterProgram program = bench.Fresh();
    const auto block = plc.form().ToBlock(program);
    if (!block) return;
    const auto staged = plc.link().Stage(*block);
    const auto read = plc.link().ReadStaged();
    if (!bench.Refute(Rule::kStores, staged && read,
                      staged ? (read ? "" : read.error().message) : staged.error().message)) {
      return;
    }
    if (bench.CompareStaged(program)) bench.ExpectAccepted(program);
  });
}

void AcceptNumber(Bench& bench, const std::string& name, std::uint32_t number) {
  bench.Run(name, [&] {
    bench.JumpTo(number - 1);
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program)) bench.ExpectAccepted(program);
  });
}

// Numbers that show a register that is too small, a sign, or a comparison for order. From a PLC
// that compares for order the large ones would not be come back from.
void PlaySequences(Bench& bench) {
  const std::uint32_t most = bench.plc().max_sequence();
  const std::uint32_t begin = bench.active().sequence;
  if (most - begin > 3 * kRoom) {
    AcceptNumber(bench, "commit a sequence that skips a thousand", begin + kRoom);
    AcceptNumber(bench, "commit a sequence that goes back", begin + kRoom / 2);
  }
  for (const std::uint32_t number :
       {std::uint32_t{0x7fff}, std::uint32_t{0x8000}, std::uint32_t{0x00010002},
        std::uint32_t{0x12345678}, std::uint32_t{0x7fffffff}, std::uint32_t{0x80000000}}) {
    if (number >= most || bench.is_broken(Rule::kAccepts)) continue;
    AcceptNumber(bench, "commit sequence " + std::to_string(number), number);
  }
  if (!bench.is_broken(Rule::kAccepts)) {
    AcceptNumber(bench, "commit a much smaller sequence", begin + 2 * kRoom);
  }
}

}  // namespace

void PlayCommits(Bench& bench) {
  Accept(bench, "commit a good program");
  Accept(bench, "commit the next one");
  PlayOrders(bench);
  PlayFields(bench);
  PlaySequences(bench);
  Plc& plc = bench.plc();
  bench.Run("write the accepted commit once more", [&] {
    const RegisterProgram program = bench.Fresh();
    if (!bench.StageAndCompare(program)) return;
    bench.ExpectAccepted(program);
    const auto before = plc.State();
    if (!before || !plc.Commit(program.sequence)) return;
    bench.ExpectQuiet("a commit that was written twice");
    const auto after = plc.State();
    if (!after) return;
    const bool same = after->reply == before->reply && after->reply_code == before->reply_code &&
                      after->reply_sequence == before->reply_sequence;
    bench.Expect(Rule::kReply, same, "it answers a write that does not change the commit register");
  });
  bench.Run("write commit 0 with a good program staged", [&] {
    const RegisterProgram program = bench.Fresh();
    if (bench.StageAndCompare(program) && plc.Commit(0)) bench.ExpectQuiet("a commit of 0");
  });
  Accept(bench, "commit a good program after a commit of 0");
}

void PlayWrapAround(Bench& bench) {
  const std::uint32_t most = bench.plc().max_sequence();
  if (bench.is_broken(Rule::kAccepts)) return;  // it would not be come back from
  bench.JumpTo(most - 2);
  for (const char* name : {"commit the largest sequence but one", "commit the largest sequence",
                           "commit sequence 1 after it", "commit the one after the wrap-around"}) {
    Accept(bench, name);
  }
}

}  // namespace bendloop::host
