// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "firmware-host/acceptance/acceptance.h"
#include "firmware-host/acceptance/plc.h"
#include "firmware-host/acceptance/register_program.h"
#include "firmware-host/acceptance/rules.h"

namespace bendloop::host {

struct BenchOptions {
  std::chrono::milliseconds reply_timeout{5000};  // from the commit to the reply
  std::chrono::milliseconds poll_period{2};       // of the state meanwhile
  // How long the first accepted and the first rejected commits are watched after their reply: a PLC
  // that writes its registers over several scan cycles shows it.
  std::chrono::milliseconds watch{600};
  // How long nothing may happen where nothing was asked; and thrice the slowest reply so far.
  std::chrono::milliseconds quiet{50};
  // After the last commit, a rejected one: what a PLC does late shows itself.
  std::chrono::milliseconds late{6000};
  // In which a heartbeat that counts is seen to.
  std::chrono::milliseconds standstill{2000};
};

// What a commit led to.
struct Answer {
  bool replied = false;
  bool accepted = false;
  std::uint32_t code = 0;
};

// Where the scripts work: runs exchanges one by one, judges what the PLC does by the rules, and
// knows which program should be active.
class Bench {
 public:
  // Both must outlive it. `done` is told of each exchange at its end.
  Bench(Plc& plc, Acceptance& result, BenchOptions options,
        std::function<void(const Exchange&)> done);

  Plc& plc() { return plc_; }
  const BenchOptions& options() const { return options_; }
  // The program that was active when all began, and the one that should be now.
  const RegisterProgram& found() const { return found_; }
  const RegisterProgram& active() const { return active_; }
  // Looks at the PLC, which held `found` when the run began. False: see its trouble.
  bool Begin(const RegisterProgram& found);
  // What is active now is what should be from here on.
  void Adopt(const RegisterProgram& active) { active_ = active; }
  // The link is gone: every exchange from here on is left out.
  bool is_lost() const { return !result_.trouble.empty(); }

  void Run(const std::string& name, const std::function<void()>& exchange);
  // In an exchange. A rule is tried, and kept or broken.
  bool Expect(Rule rule, bool kept, const std::string& otherwise);
  // The same, where being kept proves nothing: it only may be broken.
  bool Refute(Rule rule, bool kept, const std::string& otherwise);
  // In an exchange: it cannot be done here. What it would have tried stays untried by it.
  void LeaveOut(const std::string& why);
  // Why a rule was not tried, if nothing tries it.
  void Explain(Rule rule, const std::string& why);
  void ExplainAll(const std::string& why);

  // The found program with every angle and the end's length changed by a few hundredths, and a
  // sequence that nobody has used: harmless if it is bent by accident.
  RegisterProgram Fresh();
  std::uint32_t FreshSequence();
  // So that the next one's neighbours are not used otherwise.
  void LeaveGap() {
    for (int i = 0; i < 4; ++i) FreshSequence();
  }
  // Numbers after it are given out next.
  void JumpTo(std::uint32_t sequence) { last_sequence_ = sequence; }
  void Sign(RegisterProgram& program) { program.crc = plc_.form().Crc(program); }

  // Stages it, compares what is read back (R3) and looks whether it moved anything (R4). False: do
  // not commit it.
  bool StageAndCompare(const RegisterProgram& program);
  bool CompareStaged(const RegisterProgram& program);
  // Commits what is staged and expects it to become active (R12, R13, R14, R16).
  void ExpectAccepted(const RegisterProgram& program);
  // Commits `number` with `staged` in staging and expects a rejection that changes nothing (`rule`,
  // R15, R16).
  void ExpectRejected(Rule rule, std::uint32_t number, const RegisterProgram& staged);
  // The same for a program that is staged first; its own number is committed.
  void StageAndExpectRejected(Rule rule, const RegisterProgram& program);
  // Nothing was asked: nothing may change for a while (R4).
  void ExpectQuiet(const std::string& after) { ExpectQuiet(after, options_.quiet); }
  void ExpectQuiet(const std::string& after, std::chrono::milliseconds least);
  bool is_last_rejected() const { return last_was_rejected_; }
  bool is_broken(Rule rule) const { return result_.of(rule).outcome == Outcome::kFailed; }
  // Writes `number` to commit and waits for what becomes of it. `program`, if it is given, should
  // become active.
  Answer CommitAndWait(std::uint32_t number, const RegisterProgram* program = nullptr);

 private:
  struct Watch;
  void Judge(Rule rule, bool kept, const std::string& otherwise);
  bool LookAfterTrouble(bool again);
  void CheckDrift();
  // Makes what is active a harmless program again.
  void Recover();
  void SeeReply(const PlcState& state, Watch& watch);
  void JudgeReply(const Watch& watch);
  void SeeRejectedGood(const RegisterProgram& program, const Answer& answer);
  bool TakesOtherCrc(const RegisterProgram& rejected);
  void SampleActive(Watch& watch);
  void AwaitActive(const RegisterProgram& program);
  std::chrono::nanoseconds ReplyTimeout() const;

  Plc& plc_;
  Acceptance& result_;
  const BenchOptions options_;
  const std::function<void(const Exchange&)> done_;
  RegisterProgram found_;
  RegisterProgram active_;
  hal::ProgramBlock found_block_;
  std::uint32_t last_sequence_ = 0;
  std::uint32_t last_commit_ = 0;
  std::uint32_t variant_ = 0;
  Exchange* exchange_ = nullptr;
  bool begun_ = false;
  bool judging_ = true;
  bool last_was_rejected_ = false;
  // So many commits are still to be watched. One is enough where a look fell between it and its
  // reply, which a quick PLC, or a loaded machine, does not leave at each.
  int accepted_watches_ = 3;
  int rejected_watches_ = 1;
  std::chrono::nanoseconds settle_{0};  // by which replies change after they were given
  std::chrono::nanoseconds slowest_reply_{0};
  std::size_t missing_replies_ = 0;
  bool has_other_crc_ = false;
};

}  // namespace bendloop::host
