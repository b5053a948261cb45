// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_protocol.h"

#include <utility>

namespace bendloop::host {
namespace {

CommitReport Refused(std::string reason) {
  return {CommitOutcome::kRefused, std::move(reason), 0, {}};
}
CommitReport Failed(std::string reason) {
  return {CommitOutcome::kFailed, std::move(reason), 0, {}};
}
// Before anything was sent.
CommitReport NotNow(CommitReport report) {
  report.may_be_repeated = true;
  return report;
}

// Empty: ready.
std::string WhyNotReady(const hal::BenderState& state) {
  switch (state.mode) {
    case hal::BenderMode::kIdle:
      return "";
    case hal::BenderMode::kBending:
      return "the bender is bending; wait for the end of the cycle";
    case hal::BenderMode::kNotReady:
      return "the bender is not ready (off, homing, setup or guard open)";
    case hal::BenderMode::kFault:
      return "the bender is in fault, code " + std::to_string(state.fault_code) +
             "; clear it at its panel";
  }
  return "the bender's mode is unknown";
}

std::string Rejection(const hal::BenderState& state) {
  return "the bender rejected the program, reply code " + std::to_string(state.reply_code) +
         " (see the bender's manual)";
}

std::string WhyLocked(const std::string& breach) {
  if (IsOfJournal(breach)) {
    return "nothing was sent: corrections are locked since " + breach +
           ", and what was sent before is not known; look at the program that the bender holds, "
           "then 'bendloop acknowledge'";
  }
  return "nothing was sent: corrections are locked since the bender broke a rule of "
         "drivers/README.md, " +
         breach +
         "; look at the program that it holds, have the PLC mended, then 'bendloop acknowledge'";
}

}  // namespace

CommitProtocol::CommitProtocol(hal::BenderLink& link, CommitJournal& journal, hal::Clock& clock,
                               CommitOptions options)
    : link_(link), journal_(journal), clock_(clock), options_(options) {}

CommitReport EndOf(const CommitAttempt& attempt) {
  CommitReport report;
  report.attempt = attempt.id;
  report.sequence = attempt.next.sequence;
  if (attempt.step == CommitStep::kCommitted) {
    report.outcome = CommitOutcome::kCommitted;
    report.active = attempt.next;
  } else {
    const bool failed = attempt.step == CommitStep::kFailed;
    report.outcome = failed ? CommitOutcome::kFailed : CommitOutcome::kRefused;
    report.reason = attempt.detail;  // which says what was active
  }
  return report;
}

void CommitProtocol::Observe(const hal::BenderState& state) {
  if (last_heartbeat_ && *last_heartbeat_ != state.heartbeat) heartbeat_changed_ = clock_.Now();
  last_heartbeat_ = state.heartbeat;
}

CommitReport CommitProtocol::Commit(const CommitRequest& request) {
  if (auto refusal = CheckBefore(request)) return *refusal;
  if (auto refusal = CheckUnchanged(request.base)) return *refusal;
  if (const std::string locked = Locked(); !locked.empty()) return Refused(WhyLocked(locked));

  CommitAttempt attempt{0, request.session, request.base, {}, CommitStep::kBegun, ""};
  const auto sequence = FreshSequence();
  if (!sequence) return NotNow(Failed(sequence.error().message));
  auto next = link_.Encode({request.base.part_number, *sequence, request.program, 0});
  if (!next) {
    return next.error().kind == hal::ErrorKind::kBadInput ? Refused(next.error().message)
                                                          : Failed(next.error().message);
  }
  attempt.next = *next;

  const auto id = journal_.Begin(attempt);
  if (!id) return Refused("nothing was sent: " + id.error().message);
  attempt.id = *id;
  facts_ = {};
  if (auto refusal = StageAndVerify(attempt)) return StopBefore(attempt, *refusal);

  // Whatever happened on the shop floor while we staged: look again, then commit at once.
  const auto state = link_.ReadState();
  if (!state) return StopBefore(attempt, Failed(state.error().message));
  if (const std::string why = WhyNotReady(*state); !why.empty()) {
    return StopBefore(attempt, NotNow(Refused(why)));
  }
  if (info_.atomic_commit) {
    if (auto refusal = CheckUnchanged(request.base)) return StopBefore(attempt, *refusal);
  }
  if (auto ok = journal_.Append(attempt.id, CommitStep::kCommitting, ""); !ok) {
    return StopBefore(attempt, Refused("the commit was not sent: " + ok.error().message));
  }
  attempt.step = CommitStep::kCommitting;
  facts_.committed = true;
  const auto written = link_.Commit(attempt.next.sequence);
  return AwaitReply(attempt, written ? "" : written.error().message);
}

// The commit was not written. A bender that keeps the rules holds the old program still; what is
// left in staging is made the old program's, for one that does not.
CommitReport CommitProtocol::StopBefore(const CommitAttempt& attempt, CommitReport report) {
  // Without a commit register staging has touched the active program: look what is left of it.
  if (!info_.atomic_commit) return Settle(attempt, report.reason);
  if (const auto active = LookAtActive(attempt); active && facts_.activated) {
    return Settle(attempt, report.reason);
  }
  (void)Disarm(attempt);
  return Finish(attempt, std::move(report));
}

CommitProtocol::Refusal CommitProtocol::CheckBefore(const CommitRequest& request) {
  const auto unfinished = journal_.Unfinished();
  if (!unfinished) return Refused("nothing was sent: " + unfinished.error().message);
  if (*unfinished) {
    const auto resumed = Resume();
    if (!resumed || resumed->outcome == CommitOutcome::kUnknown) {
      return NotNow(Refused("an earlier commit is not settled yet: " +
                            (resumed ? resumed->reason : "the journal cannot be read")));
    }
  }
  const auto stale = journal_.SessionCommitted(request.session);
  if (!stale) return Refused("nothing was sent: " + stale.error().message);
  if (*stale) {
    return Refused("session " + request.session +
                   " has already led to a commit; scan a part that the new program bent");
  }
  auto info = link_.Connect();
  if (!info) return NotNow(Failed(info.error().message));
  info_ = *info;
  if (!info_.atomic_commit && !options_.allow_non_atomic) {
    return Refused(
        "the bender has no commit register, so a program cannot be exchanged in one "
        "step; the cell must allow it explicitly");
  }
  auto state = link_.ReadState();
  if (!state) return NotNow(Failed(state.error().message));
  if (auto refusal = CheckAlive(*state)) return refusal;
  if (const std::string why = WhyNotReady(*state); !why.empty()) return NotNow(Refused(why));
  return std::nullopt;
}

CommitProtocol::Refusal CommitProtocol::CheckAlive(hal::BenderState& state) {
  if (!info_.has_heartbeat) return std::nullopt;
  Observe(state);
  const auto deadline = clock_.Now() + options_.heartbeat_timeout;
  while (!heartbeat_changed_ || clock_.Now() - *heartbeat_changed_ > options_.heartbeat_timeout) {
    if (clock_.Now() >= deadline) {
      return NotNow(Refused("the bender's heartbeat stands still at " +
                            std::to_string(state.heartbeat) + ": its controller does not run"));
    }
    clock_.SleepFor(options_.poll_period);
    const auto read = link_.ReadState();
    if (!read) return NotNow(Failed(read.error().message));
    state = *read;
    Observe(state);
  }
  return std::nullopt;
}

CommitProtocol::Refusal CommitProtocol::CheckUnchanged(const hal::ProgramBlock& base) {
  const auto active = link_.ReadActive();
  if (!active) return NotNow(Failed(active.error().message));
  ObserveActive(*active);
  if (*active == base) return std::nullopt;
  CommitReport report = Refused("other program active: the part was bent by " + Describe(base) +
                                "; the bender now holds " + Describe(*active) + " (" +
                                FirstDifference(*active, base) + ")");
  report.active = *active;
  return report;
}

CommitProtocol::Refusal CommitProtocol::StageAndVerify(const CommitAttempt& attempt) {
  if (auto ok = link_.Stage(attempt.next); !ok) return Failed(ok.error().message);
  const auto staged = link_.ReadStaged();
  if (!staged) return Failed(staged.error().message);
  const std::string difference = FirstDifference(*staged, attempt.next);
  if (difference.empty()) return std::nullopt;
  return Failed("the staged program reads back differently: " + difference +
                "; it was not committed");
}

hal::Result<std::uint32_t> CommitProtocol::FreshSequence() {
  const auto state = link_.ReadState();
  if (!state) return hal::Fail(state.error());
  const auto last = journal_.LastSequence();
  if (!last) return hal::Fail(last.error());
  // Staging may hold anything, and is overwritten anyway.
  const auto staged = link_.ReadStaged();
  return NextSequenceNumber(
      {state->active_sequence, state->reply_sequence, *last, staged ? staged->sequence : 0},
      info_.max_sequence);
}

void CommitProtocol::NoteAnswer(const CommitAttempt& attempt, const hal::BenderState& state) {
  if (state.reply_sequence != attempt.next.sequence || state.reply == hal::CommitReply::kNone) {
    return;
  }
  facts_.answer = state.reply;
  facts_.reply_code = state.reply == hal::CommitReply::kRejected ? state.reply_code : 0;
}

hal::Result<hal::ProgramBlock> CommitProtocol::LookAtActive(const CommitAttempt& attempt) {
  const auto note = [&](const hal::ProgramBlock& active) {
    const bool is_void = journal_.IsVoid(active.sequence).value_or(false) &&
                         active.sequence != attempt.base.sequence;
    NoteActive(active, attempt.base, attempt.next, is_void, facts_);
  };
  auto active = link_.ReadActive();
  if (active) {
    note(*active);
    return active;
  }
  // It did not answer, or what it holds does not fit its crc: is it ours, spoiled?
  auto raw = link_.ReadActiveAsItStands();
  if (!raw) return active;
  CommitFacts before = facts_;
  note(*raw);
  if (facts_.read_back == ReadBack::kSpoiled) {
    facts_.difference += " (and its crc does not fit its rows)";
    return raw;
  }
  facts_ = before;
  return active;
}

CommitReport CommitProtocol::AwaitReply(const CommitAttempt& attempt, std::string why) {
  const auto deadline = clock_.Now() + options_.reply_timeout;
  for (;;) {
    const auto state = link_.ReadState();
    if (!state) why = state.error().message;
    if (state) NoteAnswer(attempt, *state);
    const bool answered = facts_.answer != hal::CommitReply::kNone;
    if (state && (answered || !info_.atomic_commit)) {
      const auto active = LookAtActive(attempt);
      if (!active) why = active.error().message;
      if (active && *active == attempt.next) {
        return Finish(attempt, {CommitOutcome::kCommitted, "", 0, *active});
      }
      if (active && *active == attempt.base) {
        // Not left in staging, where a repeated commit could still find it.
        if (facts_.answer == hal::CommitReply::kRejected) {
          return Settle(attempt, Rejection(*state), CommitOutcome::kRefused);
        }
        facts_.answered_early = answered;
      }
    }
    if (clock_.Now() >= deadline) break;
    clock_.SleepFor(options_.poll_period);
  }
  const std::string within = " within " + std::to_string(options_.reply_timeout.count()) + " ms";
  if (!ProvenBreach(facts_).empty()) {
    why.clear();  // says more
  } else if (why.empty() && facts_.answer == hal::CommitReply::kNone) {
    why = "the bender did not answer the commit" + within;
  } else if (why.empty()) {
    why = "the bender answered, and the new program did not become active" + within;
  }
  return Settle(attempt, why);
}

// The commit may have been executed, lost, or may still be on its way. Reads what is active; if it
// is not the new program, makes sure that it cannot become so later, and looks again.
CommitReport CommitProtocol::Settle(const CommitAttempt& attempt, std::string why,
                                    CommitOutcome otherwise) {
  facts_.committed = attempt.step == CommitStep::kCommitting;
  const auto unknown = [&](const std::string& trouble) {
    CommitReport report{CommitOutcome::kUnknown,
                        why + (why.empty() ? "" : "; ") +
                            "it is not known yet whether the bender holds the old program (" +
                            Describe(attempt.base) + ") or the new one (" + Describe(attempt.next) +
                            "): " + trouble,
                        attempt.next.sequence,
                        {}};
    report.attempt = attempt.id;
    return report;
  };
  if (const auto state = link_.ReadState()) NoteAnswer(attempt, *state);
  auto active = LookAtActive(attempt);
  if (!active) return unknown(active.error().message);
  if (*active != attempt.next && attempt.step == CommitStep::kCommitting && info_.atomic_commit) {
    if (auto ok = Disarm(attempt); !ok) return unknown(ok.error().message);
    active = LookAtActive(attempt);
    if (!active) return unknown(active.error().message);
  }
  CommitReport report{otherwise, why, 0, *active};
  const auto add = [&](const std::string& text) {
    report.reason += (report.reason.empty() ? "" : "; ") + text;
  };
  const std::string breach = info_.atomic_commit ? ProvenBreach(facts_) : "";
  if (!breach.empty()) add("the bender broke a rule of drivers/README.md, " + breach);
  if (*active == attempt.next) {
    report.outcome = CommitOutcome::kCommitted;
    if (breach.empty()) report.reason.clear();
  } else if (*active == attempt.base) {
    add("the old program is active (" + Describe(*active) + ")");
  } else if (active->program.rows.empty()) {
    add("the bender holds a disabled program (row count 0) and will bend nothing: "
        "load the program at its panel");
  } else {
    add("the bender holds another program (" + Describe(*active) + ")");
  }
  return Finish(attempt, report);
}

// A commit that arrives late names a sequence that is no longer staged, and is rejected; a bender
// that does not compare finds the old program's own rows.
hal::Result<void> CommitProtocol::Disarm(const CommitAttempt& attempt) {
  const auto sequence = FreshSequence();
  if (!sequence) return hal::Fail(sequence.error());
  if (auto ok = journal_.NoteVoid(*sequence); !ok) return ok;
  hal::ProgramBlock block = attempt.base;
  block.sequence = *sequence;
  // A program that was loaded at the panel need not fit; the new one does.
  const auto encoded = link_.Encode(block);
  if (!encoded || encoded->program != attempt.base.program) {
    block = attempt.next;
    block.sequence = *sequence;
  }
  return link_.Stage(block);
}

CommitReport CommitProtocol::Finish(const CommitAttempt& attempt, CommitReport report) {
  report.attempt = attempt.id;
  report.sequence = attempt.next.sequence;
  report.facts = facts_;
  if (info_.atomic_commit) report.breach = ProvenBreach(facts_);
  if (!report.breach.empty()) {
    // First, so that no crash loses it.
    NoteBreach("attempt " + std::to_string(attempt.id), report.breach);
    if (report.reason.empty()) {
      report.reason = "the bender broke a rule of drivers/README.md, " + report.breach;
    }
  }
  CommitStep step = CommitStep::kNotCommitted;
  if (report.outcome == CommitOutcome::kCommitted) step = CommitStep::kCommitted;
  if (report.outcome == CommitOutcome::kFailed) step = CommitStep::kFailed;
  const std::string detail = report.reason + (report.reason.empty() ? "" : "; ") + Describe(facts_);
  if (auto ok = journal_.Append(attempt.id, step, detail); !ok) {
    // The bender's state is known all the same; the next start asks it again.
    report.reason += (report.reason.empty() ? "" : "; ") + ok.error().message;
  }
  return report;
}

void CommitProtocol::NoteBreach(const std::string& cause, const std::string& breach) {
  // A disk that does not take it must not unlock the bender while we live.
  if (!journal_.NoteBreach(cause, breach)) lost_breach_ = breach;
}

void CommitProtocol::ObserveActive(const hal::ProgramBlock& active) {
  if (std::exchange(seen_sequence_, active.sequence) == active.sequence) return;
  if (!journal_.IsVoid(active.sequence).value_or(false)) return;
  CommitFacts facts;
  facts.read_back = ReadBack::kVoid;
  NoteBreach("void " + std::to_string(active.sequence), ProvenBreach(facts));
}

std::string CommitProtocol::Locked() const {
  const auto open = journal_.OpenBreach();
  if (!open) return open.error().message;
  return *open ? **open : lost_breach_;
}

hal::Result<void> CommitProtocol::Acknowledge(const std::string& who) {
  auto done = journal_.Acknowledge(who);
  if (done) lost_breach_.clear();
  return done;
}

std::optional<CommitReport> CommitProtocol::Resume(std::string* session) {
  const auto unfinished = journal_.Unfinished();
  if (!unfinished) {
    return CommitReport{CommitOutcome::kUnknown, unfinished.error().message, 0, {}};
  }
  if (!*unfinished) return std::nullopt;
  const CommitAttempt& attempt = **unfinished;
  if (session != nullptr) *session = attempt.session;
  const auto info = link_.Connect();
  if (!info) {
    return CommitReport{
        CommitOutcome::kUnknown,
        "a commit was interrupted and the bender cannot be asked: " + info.error().message,
        attempt.next.sequence,
        {}};
  }
  info_ = *info;
  facts_ = {};
  return Settle(attempt, attempt.step == CommitStep::kCommitting
                             ? "the commit was interrupted"
                             : "interrupted before the commit was sent");
}

}  // namespace bendloop::host
