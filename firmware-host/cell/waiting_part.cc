// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/waiting_part.h"

#include <utility>

#include "firmware-host/workers/want_of_memory.h"

namespace bendloop::host {
namespace {

using namespace std::chrono_literals;

// Between two attempts: the bender answers a look in less, and has to stay idle for one.
constexpr auto kAgainPeriod = 500ms;

}  // namespace

void WaitingPart::Take(MeasuredPart part, const PartOutcome& outcome,
                       std::shared_ptr<const PartPlan> plan) {
  decided_at_ = clock_.Now();
  if (outcome.end != PartEnd::kWaiting) return;
  waiting_.emplace(Waiting{std::move(part), outcome, std::move(plan)});
}

void WaitingPart::set_latency(const PartLatency& latency) {
  if (waiting_) waiting_->outcome.latency = latency;
}

std::optional<PartOutcome> WaitingPart::Tend(bool bender_is_idle) {
  if (!waiting_) return std::nullopt;
  if (attempt_.valid()) {
    if (attempt_.wait_for(0s) != std::future_status::ready) return std::nullopt;
    life_.Rest();
    return Finish(attempt_.get());
  }
  const double age_s = SecondsBetween(*waiting_->part.scan.ended, desk_.Now());
  const bool is_old = age_s > waiting_->plan->interlocks.oldest_session_s;
  const auto now = clock_.Now();
  if (!is_old && (!bender_is_idle || now - decided_at_ < kAgainPeriod)) return std::nullopt;
  decided_at_ = now;
  if (IsOnItsWay()) {
    waiting_.reset();
    return std::nullopt;
  }
  if (is_old) waiting_->part.may_wait = false;  // the last time: it says why
  attempt_ = std::async(std::launch::async, [this] {
    life_.Expect(2 * desk_.exchange_bound() + kDiskBound);
    return DecidePart(*waiting_->plan, waiting_->part, desk_);
  });
  return std::nullopt;
}

// An attempt before sent it, and there was no memory to say so: the desk tells how that ended.
bool WaitingPart::IsOnItsWay() const {
  const std::string& session = waiting_->part.identity.session;
  return desk_.SessionCommitted(session) || desk_.OpenCommit() == session;
}

std::optional<PartOutcome> WaitingPart::Finish(PartOutcome outcome) {
  outcome.latency = waiting_->outcome.latency;
  if (outcome.end == PartEnd::kWaiting) {
    // What it taught may have become known meanwhile.
    const bool is_news = outcome.next.has_value() && !waiting_->outcome.next;
    waiting_->outcome = outcome;
    if (!is_news) return std::nullopt;
    return outcome;
  }
  waiting_.reset();
  return outcome;
}

std::optional<PartOutcome> WaitingPart::GiveUp(const std::string& why) {
  if (!waiting_) return std::nullopt;
  if (attempt_.valid()) {
    std::optional<PartOutcome> last;  // none: there was no memory for it
    HasMemoryFor([&] { last = attempt_.get(); });
    if (last && last->end != PartEnd::kWaiting) return Finish(std::move(*last));
    if (last) Finish(std::move(*last));
  }
  if (IsOnItsWay()) {
    waiting_.reset();
    return std::nullopt;
  }
  PartOutcome outcome = std::move(waiting_->outcome);
  waiting_.reset();
  GiveUpWaiting(why, outcome, desk_);
  return outcome;
}

}  // namespace bendloop::host
