// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "hal/bend_program.h"
#include "hal/bender_state.h"
#include "pipeline/correction/correction.h"
#include "pipeline/inspection/direction.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/pass_offsets.h"

namespace bendloop::pipeline {

struct InterlockOptions {
  double least_coverage = 0.9;              // part of the spine seen, 0..1
  double longest_gap_mm = 60.0;             // of the spine not seen
  double most_rms_mm = 0.3;                 // of the samples from the fitted tube
  double most_lost_profiles = 0.02;         // part of all profiles, 0..1
  double most_pipe_radius_deviation = 0.1;  // part of the nominal pipe radius
  PerAxis most_sigma{0.3, 0.3, 0.2};        // 1 sigma: worse rows are held by themselves
  double least_angle_deg = 2.0;             // rotations beside smaller bends are not checked
  double oldest_session_s = 600.0;          // since the end of the scan
  PassDrift pass_drift = {};                // passes further apart are those of a moved tube
};

// What the bender said last.
struct BenderFacts {
  hal::BenderState state;
  hal::ProgramBlock active;
};

enum class InterlockKind : std::uint8_t {
  kBendCount,
  kDirection,
  kCoverage,
  kGap,
  kFit,
  kPasses,  // where passes of the scan did not meet: by no more than an arm drifts
  kPipeRadius,
  kLostProfiles,
  kUncertaintyLength,
  kUncertaintyRotation,
  kUncertaintyAngle,
  kCorrection,
  kStaleSession,
  kUsedSession,
  kNewTube,       // a tube was bent that no scan has used yet
  kTubeCount,     // the bender's count of tubes adds up
  kTubeProgram,   // the program that bent the tube is known
  kTubeIdentity,  // the tube is the expected one, where somebody tells tubes apart
  kPartNumber,    // the tube is of this cell's part
  kBenderReady,
  kActiveProgram,
};
std::string_view Name(InterlockKind kind);  // "bend count", "direction", ...

// One of the tube's checks as whoever follows the bender made it.
struct TubeCheck {
  InterlockKind kind = InterlockKind::kNewTube;
  bool passed = false;
  std::string found;  // said always
  std::string mend;   // said when it did not pass

  bool operator==(const TubeCheck&) const = default;
};

// Everything that decides whether a correction may be sent. Plain values: fill in what is known.
struct InterlockInput {
  std::size_t nominal_bends = 0;
  DirectionMatch direction;
  hal::BendProgram measured;  // in the nominal's order when it is known
  hal::BendProgram sigma;
  double coverage = 0;  // 0..1
  double longest_gap_mm = 0;
  FitQuality fit;
  std::vector<PassOffset> passes = {};  // as in Measurement
  double pipe_radius_mm = 0;
  std::optional<double> nominal_pipe_radius_mm;
  std::uint64_t profiles = 0;       // received
  std::uint64_t profiles_lost = 0;  // by sequence numbers and full queues
  double session_age_s = 0;         // since the end of the scan
  bool session_used = false;        // a program was already committed from this session
  std::optional<Correction> correction;
  // false: a run that sends nothing; the checks of the bender are left out.
  bool sends = true;
  std::optional<BenderFacts> bender;  // empty: it did not answer
  hal::ProgramBlock bent_with;        // the program that bent this part
  // What the bender must hold for the correction to be its next program: what our own corrections
  // have made since of the one that bent this part. Empty: `bent_with`.
  std::optional<hal::ProgramBlock> expected = {};
  // The part's number in the cell's files; empty: not compared.
  std::optional<std::uint32_t> part_number = {};
  // What is known of which tube this is, and with what it was bent.
  std::vector<TubeCheck> tube = {};
};

struct Interlock {
  InterlockKind kind = InterlockKind::kBendCount;
  bool passed = false;
  double value = 0;  // what was found, in the unit of the sentence; NaN where it is not a number
  double limit = 0;
  std::string sentence;  // for a setter: what was found, the limit and, if it failed, what to do
};

struct InterlockReport {
  std::vector<Interlock> checks;  // every check, in the order of InterlockKind

  bool passed() const;
  std::vector<std::string> refusals() const;  // the sentences of those that failed
};

// All checks are made; one that fails does not hide another.
InterlockReport CheckInterlocks(const InterlockInput& input, const InterlockOptions& options);

}  // namespace bendloop::pipeline
