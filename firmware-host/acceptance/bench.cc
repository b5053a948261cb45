// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/bench.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bendloop::host {
namespace {

using std::chrono::nanoseconds;

std::string InMs(nanoseconds time) {
  return std::to_string(std::chrono::duration_cast<std::chrono::milliseconds>(time).count()) +
         " ms";
}

// After so many commits without a reply the rest need not be waited for as long.
constexpr std::size_t kPatientTimes = 3;
// A PLC that answered with an error is asked so often whether it is there, this much later.
constexpr int kProbes = 4;
constexpr std::chrono::milliseconds kProbePause{250};

template <class T>
void AddOnce(std::vector<T>& list, T item) {
  if (std::find(list.begin(), list.end(), item) == list.end()) list.push_back(item);
}

}  // namespace

// A commit on its way.
struct Bench::Watch {
  std::uint32_t number = 0;
  const RegisterProgram* program = nullptr;
  nanoseconds begin{0};
  nanoseconds written_at{0};     // at the latest
  nanoseconds unanswered_at{0};  // it had not replied by then
  nanoseconds replied_at{0};     // at the latest
  nanoseconds until{0};          // after the reply
  bool samples = false;
  bool looked = false;  // at the active program, between commit and reply
  std::uint32_t reply = 0;
  Answer answer;
};

Bench::Bench(Plc& plc, Acceptance& result, BenchOptions options,
             std::function<void(const Exchange&)> done)
    : plc_(plc), result_(result), options_(options), done_(std::move(done)) {}

bool Bench::Begin(const RegisterProgram& found) {
  const auto state = plc_.State();
  const auto active = plc_.Active();
  const auto staged = plc_.Staged(0);
  if (!state || !active || !staged) return false;
  found_ = found;
  active_ = *active;
  last_sequence_ = std::max({active->sequence, state->reply_sequence, staged->sequence});
  const auto block = plc_.form().ToBlock(found);
  if (block) found_block_ = *block;
  begun_ = block.has_value();
  return begun_;
}

void Bench::Run(const std::string& name, const std::function<void()>& script) {
  if (is_lost()) return;
  result_.exchanges.push_back({result_.exchanges.size() + 1, name, {}, {}, {}, {}, {}});
  exchange_ = &result_.exchanges.back();
  // A telegram may get lost on any line: what failed once is tried once more.
  for (const bool again : {false, true}) {
    plc_.frames().Clear();
    CheckDrift();
    script();
    if (!plc_.trouble() || LookAfterTrouble(again)) break;
  }
  Exchange& exchange = *exchange_;
  bool shows = exchange.outcome == Outcome::kFailed;
  for (const Rule rule : exchange.rules) {
    RuleResult& of = result_.of(rule);
    const bool fails = std::count(exchange.broken.begin(), exchange.broken.end(), rule) > 0;
    if (of.shown_by != 0 && !(fails && of.failed == 1)) continue;
    of.shown_by = exchange.number;
    shows = true;
  }
  if (shows) exchange.frames = plc_.frames().frames();
  exchange_ = nullptr;
  if (done_) done_(exchange);
}

// True: that was it.
bool Bench::LookAfterTrouble(bool again) {
  const Trouble trouble = *plc_.TakeTrouble();
  for (int i = 0; i < kProbes; ++i) {
    if (i > 0) plc_.clock().SleepFor(kProbePause);
    if (!plc_.Answers()) continue;
    if (again) Judge(trouble.rule, false, trouble.text);
    return again;
  }
  result_.trouble = trouble.text;
  exchange_->detail = trouble.text;
  return true;
}

bool Bench::Expect(Rule rule, bool kept, const std::string& otherwise) {
  if (!plc_.trouble() && judging_) Judge(rule, kept, otherwise);
  return kept;
}

bool Bench::Refute(Rule rule, bool kept, const std::string& otherwise) {
  if (plc_.trouble() || !judging_) return kept;
  if (!kept) Judge(rule, false, otherwise);
  if (exchange_->outcome == Outcome::kNotTried) exchange_->outcome = Outcome::kPassed;
  return kept;
}

void Bench::Judge(Rule rule, bool kept, const std::string& otherwise) {
  RuleResult& of = result_.of(rule);
  AddOnce(exchange_->rules, rule);
  ++of.tried;
  if (of.outcome == Outcome::kNotTried) of.outcome = Outcome::kPassed;
  if (exchange_->outcome == Outcome::kNotTried) exchange_->outcome = Outcome::kPassed;
  if (kept) return;
  if (of.failed++ == 0) of.detail = otherwise;
  of.outcome = Outcome::kFailed;
  if (exchange_->outcome != Outcome::kFailed) exchange_->detail = otherwise;
  exchange_->outcome = Outcome::kFailed;
  AddOnce(exchange_->broken, rule);
}

void Bench::LeaveOut(const std::string& why) { exchange_->detail = why; }

void Bench::Explain(Rule rule, const std::string& why) {
  RuleResult& of = result_.of(rule);
  if (of.outcome == Outcome::kNotTried) of.detail = why;
}

void Bench::ExplainAll(const std::string& why) {
  for (std::size_t i = 0; i < kRuleCount; ++i) Explain(static_cast<Rule>(i + 1), why);
}

std::uint32_t Bench::FreshSequence() {
  do {
    last_sequence_ = last_sequence_ >= plc_.max_sequence() ? 1 : last_sequence_ + 1;
  } while (last_sequence_ == active_.sequence || last_sequence_ == found_.sequence ||
           last_sequence_ == last_commit_);
  return last_sequence_;
}

RegisterProgram Bench::Fresh() {
  constexpr double kStep = 0.01;      // mm and degrees: finer than any press
  constexpr double kSmallestDeg = 1;  // below it the angle grows instead
  constexpr std::uint32_t kSteps = 5;
  const auto step = [&](const hal::RegisterField& field) {
    return field.type == hal::RegisterType::kFloat32 ? kStep
                                                     : std::max(kStep, std::abs(field.scale));
  };
  const double times = variant_++ % kSteps + 1;
  hal::ProgramBlock block = found_block_;
  for (hal::BendRow& row : block.program.rows) {
    if (&row == &block.program.rows.back()) break;
    const double change = times * step(plc_.map().row_angle_deg);
    row.angle_deg += row.angle_deg > kSmallestDeg ? -change : change;
  }
  block.program.rows.back().length_mm += times * step(plc_.map().row_length_mm);
  block.sequence = FreshSequence();
  // It fits where the found one fits.
  return plc_.form().FromBlock(block).value_or(RegisterProgram{});
}

void Bench::CheckDrift() {
  if (!begun_) return;
  const auto head = plc_.ActiveHead();
  if (!head || SameHead(*head, active_)) return;
  const auto active = plc_.Active();
  if (!active) return;
  Expect(last_was_rejected_ ? Rule::kRejectedIsNothing : Rule::kOnlyCommit, false,
         "the active program changed afterwards: " + Difference(plc_.map(), *active, active_));
  Adopt(*active);
  Recover();
}

void Bench::Recover() {
  const bool judged = std::exchange(judging_, false);
  const RegisterProgram program = Fresh();
  if (plc_.Stage(program)) {
    CommitAndWait(program.sequence);
    if (const auto active = plc_.Active()) Adopt(*active);
  }
  judging_ = judged;
}

bool Bench::StageAndCompare(const RegisterProgram& program) {
  return plc_.Stage(program) && CompareStaged(program);
}

bool Bench::CompareStaged(const RegisterProgram& program) {
  const auto staged = plc_.Staged(program.words.size() / plc_.form().stride());
  if (!staged) return false;
  const std::string difference = Difference(plc_.map(), *staged, program);
  const bool stored = Expect(Rule::kStores, difference.empty(), "staging " + difference);
  const auto head = plc_.ActiveHead();
  if (!head) return false;
  if (Expect(Rule::kOnlyCommit, SameHead(*head, active_), "staging changed the active program")) {
    return stored;
  }
  if (const auto active = plc_.Active()) Adopt(*active);
  return false;
}

nanoseconds Bench::ReplyTimeout() const {
  if (missing_replies_ < kPatientTimes) return options_.reply_timeout;
  return std::min<nanoseconds>(options_.reply_timeout,
                               std::max<nanoseconds>(options_.quiet, 4 * slowest_reply_));
}

// Takes note of a state after the commit; an answer that changes after it was given came too early.
void Bench::SeeReply(const PlcState& state, Watch& watch) {
  if (state.reply_sequence != watch.number) return;
  const hal::RegisterMap& map = plc_.map();
  const bool known = state.reply == map.reply_accepted || state.reply == map.reply_rejected;
  Answer& answer = watch.answer;
  const bool same = answer.replied && state.reply == watch.reply && state.reply_code == answer.code;
  if (same) return;
  if (answer.replied || !known) {
    Expect(Rule::kReply, false,
           "reply_sequence was there before reply and reply_code: reply " +
               std::to_string(state.reply) + " code " + std::to_string(state.reply_code) +
               (answer.replied ? " after reply " + std::to_string(watch.reply) + " code " +
                                     std::to_string(answer.code)
                               : ", which is no answer"));
  }
  if (!known) return;
  if (!answer.replied) {
    watch.replied_at = state.at;
    slowest_reply_ = std::max(slowest_reply_, state.at - watch.begin);
    watch.until = state.at + (watch.samples ? nanoseconds(options_.watch) : settle_);
  } else {
    // From now on answers are believed only after they have stood so long.
    settle_ = std::max(settle_, 2 * (state.at - watch.replied_at));
    watch.until = std::max(watch.until, state.at + settle_);
  }
  watch.reply = state.reply;
  answer = {true, state.reply == map.reply_accepted, state.reply_code};
}

// One look at the active program while a good commit is done.
void Bench::SampleActive(Watch& watch) {
  if (watch.program == nullptr) return;
  const auto sample = plc_.Active();
  const auto head = plc_.ActiveHead();
  if (!sample || !head || !SameHead(*sample, *head)) return;
  watch.looked |= !watch.answer.replied;
  const bool is_new = *sample == *watch.program;
  if (!is_new && *sample != active_) {
    Expect(Rule::kAtOnce, false,
           "for a while the active program was neither the old nor the new one: " +
               Difference(plc_.map(), *sample, *watch.program));
  } else if (!is_new && watch.answer.accepted) {
    Expect(Rule::kAtOnce, false, "the reply came before the program was active");
  }
}

Answer Bench::CommitAndWait(std::uint32_t number, const RegisterProgram* program) {
  Watch watch;
  watch.number = number;
  watch.program = program;
  watch.begin = plc_.clock().Now();
  int& watches = program != nullptr ? accepted_watches_ : rejected_watches_;
  watch.samples = judging_ && watches > 0;
  if (!plc_.Commit(number)) return {};
  last_commit_ = number;
  watch.written_at = watch.unanswered_at = plc_.clock().Now();
  for (;;) {
    const auto state = plc_.State();
    if (!state) return {};
    SeeReply(*state, watch);
    if (!watch.answer.replied) watch.unanswered_at = state->asked_at;
    if (watch.samples) SampleActive(watch);
    if (watch.answer.replied ? plc_.clock().Now() >= watch.until
                             : watch.unanswered_at - watch.written_at >= ReplyTimeout()) {
      break;
    }
    plc_.clock().SleepFor(options_.poll_period);
  }
  if (watch.samples) watches = watch.looked ? 0 : watches - 1;
  JudgeReply(watch);
  return watch.answer;
}

void Bench::JudgeReply(const Watch& watch) {
  if (!watch.answer.replied) {
    Expect(Rule::kReply, false, "no reply within " + InMs(ReplyTimeout()));
    ++missing_replies_;
    return;
  }
  // Far beyond the scan cycle of any PLC, and what a slow line adds to it.
  constexpr std::chrono::seconds kLongScan{1};
  const nanoseconds took = watch.replied_at - watch.begin;
  plc_.AddTiming(watch.answer.accepted ? "commit to accepted" : "commit to rejected", took);
  // What the PLC took at least: that this machine, or the line, was slow is not its fault.
  const nanoseconds least = watch.unanswered_at - watch.written_at;
  Expect(Rule::kReply, least <= kLongScan, "the reply came after " + InMs(took));
}

void Bench::ExpectAccepted(const RegisterProgram& program) {
  const Answer answer = CommitAndWait(program.sequence, &program);
  if (plc_.trouble()) return;
  last_was_rejected_ = !answer.accepted;
  if (answer.accepted) {
    Expect(Rule::kAccepts, true, "");
    AwaitActive(program);
    if (const auto staged = plc_.Staged(0)) {
      Expect(Rule::kUsedUp, staged->sequence == 0,
             "the staged sequence is still " + std::to_string(staged->sequence));
    }
    return;
  }
  SeeRejectedGood(program, answer);
}

// A good program was not taken, or so the reply says.
void Bench::SeeRejectedGood(const RegisterProgram& program, const Answer& answer) {
  const auto active = plc_.Active();
  if (!active) return;
  const bool same = *active == active_;
  if (answer.replied && !same) {
    Expect(Rule::kRejectedIsNothing, false,
           "rejected with code " + std::to_string(answer.code) + ", and yet active");
  }
  Adopt(*active);
  if (!answer.replied || !same || has_other_crc_ || TakesOtherCrc(program)) return;
  Expect(Rule::kAccepts, false,
         "a good program was rejected, reply code " + std::to_string(answer.code));
}

// Is it another way to compute the crc? Those that are met are tried.
bool Bench::TakesOtherCrc(const RegisterProgram& rejected) {
  if (is_broken(Rule::kAccepts)) return false;
  const struct {
    std::uint32_t (*of)(std::uint32_t crc);
    const char* what;
  } others[] = {
      {[](std::uint32_t crc) { return ~crc; }, "inverted once too often or too little"},
      {[](std::uint32_t crc) { return crc << 16 | crc >> 16; }, "with its words swapped"},
      {[](std::uint32_t crc) { return (crc & 0x00ff00ff) << 8 | (crc >> 8 & 0x00ff00ff); },
       "with its bytes swapped"},
  };
  for (const auto& other : others) {
    RegisterProgram program = rejected;
    program.sequence = FreshSequence();
    Sign(program);
    program.crc = other.of(program.crc);
    const bool judged = std::exchange(judging_, false);
    const bool taken = plc_.Stage(program) && CommitAndWait(program.sequence, &program).accepted;
    judging_ = judged;
    if (const auto active = plc_.Active()) Adopt(*active);
    if (!taken) continue;
    has_other_crc_ = true;
    Expect(Rule::kCrc, false, std::string("it takes the crc ") + other.what);
    return true;
  }
  return false;
}

void Bench::AwaitActive(const RegisterProgram& program) {
  const auto end = plc_.clock().Now() + options_.watch;
  for (bool late = false;; late = true) {
    const auto active = plc_.Active();
    if (!active) return;
    Adopt(*active);
    const bool same = *active == program;
    if (same || plc_.clock().Now() >= end) {
      Expect(Rule::kAtOnce, same && !late,
             same ? "the reply came before the program was active"
                  : "accepted, but active " + Difference(plc_.map(), *active, program));
      return;
    }
    plc_.clock().SleepFor(options_.poll_period);
  }
}

void Bench::ExpectRejected(Rule rule, std::uint32_t number, const RegisterProgram& staged) {
  const Answer answer = CommitAndWait(number);
  const auto active = plc_.Active();
  if (!active) return;
  last_was_rejected_ = !answer.accepted;
  const bool same = *active == active_;
  if (answer.accepted && same && staged != active_) {
    Expect(Rule::kReply, false, "the reply says accepted, and nothing became active");
  } else if (answer.accepted) {
    // The same program once more: whether it was copied or only said to be, nobody sees.
    if (!same || !is_broken(Rule::kReply)) Expect(rule, false, "accepted");
  } else if (!answer.replied && !same) {
    Expect(rule, false, "it became active");
  } else if (answer.replied) {
    Expect(rule, true, "");
    Expect(Rule::kRejectedIsNothing, same,
           "rejected with code " + std::to_string(answer.code) + ", and yet active " +
               Difference(plc_.map(), *active, active_));
  }
  if (same) return;
  Adopt(*active);
  Recover();
}

void Bench::StageAndExpectRejected(Rule rule, const RegisterProgram& program) {
  if (StageAndCompare(program)) ExpectRejected(rule, program.sequence, program);
}

void Bench::ExpectQuiet(const std::string& after, std::chrono::milliseconds least) {
  const auto wait = std::max<nanoseconds>(least, 3 * slowest_reply_);
  const auto end = plc_.clock().Now() + wait;
  while (plc_.clock().Now() < end && plc_.State()) plc_.clock().SleepFor(options_.poll_period);
  const auto active = plc_.Active();
  if (!active) return;
  const Rule rule = last_was_rejected_ ? Rule::kRejectedIsNothing : Rule::kOnlyCommit;
  if (Expect(rule, *active == active_, after + " changed the active program")) return;
  Adopt(*active);
  Recover();
}

}  // namespace bendloop::host
