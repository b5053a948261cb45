// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/setter_desk.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>
#include <utility>

#include "firmware-host/result/json.h"

namespace bendloop::host {
namespace {

constexpr std::pair<SetterWish, const char*> kNames[] = {
    {SetterWish::kNewLot, "lot new"},
    {SetterWish::kHoldLot, "lot hold"},
    {SetterWish::kReleaseLot, "lot release"},
    {SetterWish::kUndo, "undo"},
    {SetterWish::kFirstProgram, "first-program"},
    {SetterWish::kAcknowledge, "acknowledge"}};

SetterAnswer No(hal::ErrorKind kind, std::string why) { return {kind, std::move(why)}; }
SetterAnswer No(const hal::Error& error) { return {error.kind, error.message}; }

}  // namespace

const char* Name(SetterWish wish) {
  for (const auto& [of, name] : kNames) {
    if (of == wish) return name;
  }
  return "unknown";
}

std::optional<SetterWish> WishNamed(const std::string& name) {
  for (const auto& [wish, of] : kNames) {
    if (name == of) return wish;
  }
  return std::nullopt;
}

bool EndsWaiting(SetterWish wish) {
  return wish != SetterWish::kAcknowledge && wish != SetterWish::kReleaseLot;
}

SetterAnswer SetterDesk::Grant(const SetterRequest& request) {
  if (auto logged = Log(request, "asked"); !logged) return No(logged.error());
  SetterAnswer answer = Do(request);
  const std::string end = (answer.error ? "refused: " : "done: ") + answer.text;
  if (auto logged = Log(request, end); !logged && !answer.error) {
    answer.text += " (not written down: " + logged.error().message + ")";
  }
  return answer;
}

SetterAnswer SetterDesk::Do(const SetterRequest& request) {
  auto part = ports_.part(request.part_number);
  if (!part) return No(part.error());
  plan_ = std::move(*part);
  switch (request.wish) {
    case SetterWish::kNewLot:
      return NewLot();
    case SetterWish::kHoldLot:
      return HoldLot(true);
    case SetterWish::kReleaseLot:
      return HoldLot(false);
    case SetterWish::kUndo:
      return Undo(request);
    case SetterWish::kAcknowledge:
      return Acknowledge(request);
    case SetterWish::kFirstProgram:
      break;
  }
  return SendFirstProgram(request);
}

SetterAnswer SetterDesk::NewLot() {
  const auto lot = Lot();
  if (!lot || lot->hypotheses.empty()) {
    return {std::nullopt, "there is no lot yet: the next part begins one"};
  }
  hal::BendProgram base = lot->base;
  // Where the bender answers, the new lot's limits count from what it holds.
  if (const auto active = ActiveOfThisPart()) base = active->program;
  const auto next = pipeline::NextLot(*lot, base, plan_->correction);
  return Keep(next,
              "lot " + std::to_string(next.number) +
                  " begins; what is each bend's own is kept, springback and stretch are open");
}

SetterAnswer SetterDesk::HoldLot(bool held) {
  pipeline::LotState lot = Lot().value_or(pipeline::LotState{});
  lot.held = held;
  return Keep(lot, held ? "the lot is held: parts are measured and learnt from, no program changes"
                        : "the lot is released: programs are corrected again");
}

SetterAnswer SetterDesk::Keep(const pipeline::LotState& lot, const std::string& said) {
  if (auto kept = ports_.keep_lot(*plan_, lot); !kept) return No(kept.error());
  return {std::nullopt, said};
}

hal::Result<hal::ProgramBlock> SetterDesk::ActiveOfThisPart() {
  const BenderReading now = ports_.desk->Look();
  if (!now.facts) return hal::Fail(hal::ErrorKind::kDevice, now.problem);
  const hal::ProgramBlock& active = now.facts->active;
  const std::size_t rows = plan_->nominal.rows.size();
  if (active.part_number == plan_->part_number && active.program.rows.size() == rows) {
    return active;
  }
  return hal::Fail(hal::ErrorKind::kRefused,
                   "nothing was sent: the bender holds part " + std::to_string(active.part_number) +
                       " with " + std::to_string(active.program.rows.size()) +
                       " rows, this cell makes part " + std::to_string(plan_->part_number) +
                       " with " + std::to_string(rows) +
                       "; load this part's program at the bender first");
}

SetterAnswer SetterDesk::Undo(const SetterRequest& request) {
  const auto active = ActiveOfThisPart();
  if (!active) return No(active.error());
  const auto last = ports_.desk->LastAttempt();
  if (!last) {
    return No(hal::ErrorKind::kRefused, "nothing to undo: the journal knows no program sent");
  }
  if (!FirstDifference(*active, last->next).empty()) {
    return No(hal::ErrorKind::kRefused,
              "nothing was sent: the bender's program, sequence " +
                  std::to_string(active->sequence) + ", is not the one that was sent last, " +
                  std::to_string(last->next.sequence) + "; somebody changed it since");
  }
  SetterAnswer answer = Send(request, *active, last->base.program);
  if (answer.error) return answer;
  // What the lot has taught would make the same correction again.
  const SetterAnswer held = HoldLot(true);
  answer.text += held.error ? "; the lot could not be held: " + held.text
                            : "; the lot is held until 'bendloop lot release'";
  return answer;
}

SetterAnswer SetterDesk::Acknowledge(const SetterRequest& request) {
  const std::string breach = ports_.desk->Locked();
  if (auto done = ports_.desk->Acknowledge(request.who); !done) return No(done.error());
  if (breach.empty()) return {std::nullopt, "acknowledged; no rule was broken, nothing was locked"};
  return {std::nullopt, "acknowledged, and corrections are sent again; it was: " + breach};
}

SetterAnswer SetterDesk::SendFirstProgram(const SetterRequest& request) {
  const auto first = pipeline::InitialProgram(plan_->nominal, plan_->correction.material);
  if (!first) return No(first.error());
  const auto active = ActiveOfThisPart();
  if (!active) return No(active.error());
  SetterAnswer answer = Send(request, *active, *first);
  if (answer.error) return answer;
  const auto lot = Lot();
  if (lot && !lot->hypotheses.empty()) {
    const SetterAnswer kept =
        Keep(pipeline::NextLot(*lot, *first, plan_->correction), "a new lot begins");
    answer.text += "; " + kept.text;
  }
  return answer;
}

SetterAnswer SetterDesk::Send(const SetterRequest& request, const hal::ProgramBlock& base,
                              const hal::BendProgram& program) {
  if (ports_.desk->read_only()) {
    return No(hal::ErrorKind::kRefused, "nothing was sent: this cell sends to no bender");
  }
  // Each request is its own session: the journal takes each but once.
  const std::string session = std::string(Name(request.wish)) + " " + request.time;
  const CommitReport report = ports_.desk->Commit({session, base, program});
  if (report.outcome == CommitOutcome::kCommitted) {
    return {std::nullopt,
            "the bender confirmed the program as sequence " + std::to_string(report.sequence)};
  }
  const bool refused = report.outcome == CommitOutcome::kRefused;
  return No(refused ? hal::ErrorKind::kRefused : hal::ErrorKind::kDevice, report.reason);
}

hal::Result<void> SetterDesk::Log(const SetterRequest& request, const std::string& end) const {
  Json entry = {{"time", request.time}, {"who", request.who}, {"request", Name(request.wish)}};
  if (request.part_number != 0) entry["part_number"] = request.part_number;
  entry["end"] = end;
  const std::string line = Dump(entry) + "\n";
  const auto fail = [&] {
    return hal::Fail(hal::ErrorKind::kDevice, ports_.log.string() + ": cannot be written: " +
                                                  std::generic_category().message(errno) +
                                                  "; check the disk and its rights");
  };
  const int file = ::open(ports_.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (file < 0) return fail();
  const bool is_written =
      ::write(file, line.data(), line.size()) == static_cast<ssize_t>(line.size()) &&
      ::fsync(file) == 0;
  const auto problem = is_written ? hal::Result<void>{} : fail();
  ::close(file);
  return problem;
}

}  // namespace bendloop::host
