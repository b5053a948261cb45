// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <future>
#include <memory>
#include <optional>
#include <string>

#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/life_signs.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/part_run.h"
#include "hal/clock.h"

namespace bendloop::host {

// The part whose correction waits for the bender, if there is one: decided again whenever the
// bender is idle, beside the loop, which may be in the middle of the next scan.
class WaitingPart {
 public:
  // All of them outlive it; `life` is told of each attempt.
  WaitingPart(BenderDesk& desk, hal::Clock& clock, LifeSigns& life)
      : desk_(desk), clock_(clock), life_(life) {}

  explicit operator bool() const { return waiting_.has_value(); }
  // An attempt runs.
  bool is_tried() const { return attempt_.valid(); }
  // A part that was decided just now by `plan`; it waits if its outcome says so.
  void Take(MeasuredPart part, const PartOutcome& outcome, std::shared_ptr<const PartPlan> plan);
  void set_latency(const PartLatency& latency);
  // Ends an attempt or begins one. What there is to tell: how it ended, or what has become known
  // though it waits still.
  std::optional<PartOutcome> Tend(bool bender_is_idle);
  // No attempt after the one that runs, which is waited for; what there is to tell.
  std::optional<PartOutcome> GiveUp(const std::string& why);

 private:
  struct Waiting {
    MeasuredPart part;
    PartOutcome outcome;
    std::shared_ptr<const PartPlan> plan;
  };

  bool IsOnItsWay() const;
  std::optional<PartOutcome> Finish(PartOutcome outcome);

  BenderDesk& desk_;
  hal::Clock& clock_;
  LifeSigns& life_;
  std::optional<Waiting> waiting_;
  std::future<PartOutcome> attempt_;
  std::chrono::nanoseconds decided_at_{0};
};

}  // namespace bendloop::host
