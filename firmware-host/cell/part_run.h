// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/cell/part_plan.h"
#include "firmware-host/cell/run_context.h"
#include "firmware-host/result/run_result.h"
#include "hal/error.h"
#include "hal/result.h"

namespace bendloop::host {

// Which scan it is.
struct ScanIdentity {
  std::string session;  // id, e.g. "part-0007"
  std::string start;    // ISO 8601
  std::string tube;     // what the PLC calls the tube; empty: nobody told
};

// What the scan brought beside its points.
struct ScanFacts {
  std::uint64_t profiles = 0;
  std::uint64_t lost_profiles = 0;
  std::int64_t began_ns = 0;  // by the ledger's clock
  // Its recorded end; empty: its age does not count, because nothing real is written to.
  std::optional<Moment> ended;
};

// A part that is measured and waits for its decision.
struct MeasuredPart {
  ScanIdentity identity;
  ScanFacts scan;
  std::optional<pipeline::LotState> lot;
  std::optional<RunContext> recorded;  // with the session; empty: the ledger is asked
  pipeline::Measurement measurement;
  // A correction may wait for a bender that is busy or away, as far as its age allows.
  bool may_wait = false;
};

enum class PartEnd : std::uint8_t {
  kCorrected,  // a corrected program is active at the bender
  kUnchanged,  // measured; nothing had to be or was to be sent
  kRefused,    // measured; an interlock or the bender refused
  kLinkDown,   // measured; the bender could not be reached, or what it holds is unknown
  kWaiting,    // measured; the correction waits for the bender and is decided again
  kRepeat,     // measured once more; what there was to decide of its tube was decided before
};

const char* Name(PartEnd end);

// How long the answer took, from the arrival of the scan's last profile.
struct PartLatency {
  double lra_ms = 0;  // to the final LRA
  double end_ms = 0;  // to the bender's answer, or the decision not to ask it
};

// What became of one part.
struct PartOutcome {
  PartEnd end = PartEnd::kUnchanged;
  std::uint32_t part_number = 0;
  RunResult result;
  std::vector<std::string> reasons;        // why it was refused, or is not in tolerance for certain
  std::optional<pipeline::LotState> next;  // to be kept when the part counts
  RunContext context;                      // what the decision went by
  PartLatency latency;                     // 0 for a replay
  std::optional<pipeline::PassBeside> furthest_pass;  // of the scan; empty: its passes met

  bool out_of_tolerance() const;  // for certain
  // Of a command that ran this one part.
  int exit_code() const;
};

// From the measurement to the bender's answer: inspect, find the tube in the ledger, correct, check
// the interlocks, use the tube up, commit. A part that waits is decided again from the start.
// Blocks for the bender's timeouts at most.
PartOutcome DecidePart(const PartPlan& plan, const MeasuredPart& part, BenderDesk& desk);

// The correction of a part that waited is given up; `why` is for a person.
void GiveUpWaiting(const std::string& why, PartOutcome& outcome, BenderDesk& desk);

}  // namespace bendloop::host
