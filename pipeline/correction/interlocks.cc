// SPDX-License-Identifier: Apache-2.0
#include "pipeline/correction/interlocks.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/math/text.h"
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {
namespace {

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
// Carriers round, and a journal prints: programs this close are the same one.
constexpr double kSameProgram = 1e-3;

bool SameRows(const hal::BendProgram& a, const hal::BendProgram& b) {
  if (a.rows.size() != b.rows.size()) return false;
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    if (!(std::abs(a.rows[i].length_mm - b.rows[i].length_mm) <= kSameProgram) ||
        !(std::abs(hal::WrapRotationDeg(a.rows[i].rotation_deg - b.rows[i].rotation_deg)) <=
          kSameProgram) ||
        !(std::abs(a.rows[i].angle_deg - b.rows[i].angle_deg) <= kSameProgram)) {
      return false;
    }
  }
  return true;
}

class Checks {
 public:
  explicit Checks(InterlockReport& report) : report_(report) {}

  // `found` is said always, `mend` only on failure. Comparisons are written so that NaN fails.
  void Add(InterlockKind kind, bool passed, double value, double limit, const std::string& found,
           const std::string& mend) {
    report_.checks.push_back({kind, passed, value, limit, passed ? found : found + ": " + mend});
  }

 private:
  InterlockReport& report_;
};

void CheckScan(const InterlockInput& in, const InterlockOptions& options, Checks& checks) {
  const std::size_t bends = in.measured.bend_count();
  checks.Add(InterlockKind::kBendCount, bends == in.nominal_bends && !in.measured.rows.empty(),
             static_cast<double>(bends), static_cast<double>(in.nominal_bends),
             "measured " + std::to_string(bends) + " bends, the nominal has " +
                 std::to_string(in.nominal_bends),
             "check the part in the fixture and that the whole tube was scanned");
  // A wrong number of bends leaves nothing to compare: said once, above.
  if (in.direction.state != DirectionState::kWrongBends) {
    checks.Add(InterlockKind::kDirection, in.direction.settled(), kNoNumber, kNoNumber,
               in.direction.message, "nothing is corrected until this is settled");
  }
  checks.Add(InterlockKind::kCoverage, in.coverage >= options.least_coverage, 100 * in.coverage,
             100 * options.least_coverage,
             "the scan covers " + Fixed(100 * in.coverage, 1) + " % of the tube, at least " +
                 Fixed(100 * options.least_coverage, 1) + " % is needed",
             "scan the missing parts");
  checks.Add(InterlockKind::kGap, in.longest_gap_mm <= options.longest_gap_mm, in.longest_gap_mm,
             options.longest_gap_mm,
             "the longest stretch without samples is " + Fixed(in.longest_gap_mm, 1) +
                 " mm, limit " + Fixed(options.longest_gap_mm, 1) + " mm",
             "move the clamp or scan from another side");
  checks.Add(InterlockKind::kFit,
             in.fit.rms_distance_mm <= options.most_rms_mm && in.fit.samples > 0,
             in.fit.rms_distance_mm, options.most_rms_mm,
             std::to_string(in.fit.samples) + " samples lie " + Fixed(in.fit.rms_distance_mm, 3) +
                 " mm rms off the fitted tube, limit " + Fixed(options.most_rms_mm, 3) + " mm",
             "the tube moved, is dented or bowed, or the scanner needs calibration");
  if (const auto pass = FurthestPass(in.passes, options.pass_drift)) {
    checks.Add(InterlockKind::kPasses, !pass->is_moved(), pass->moved_mm, pass->limit_mm,
               pass->Text() + ", limit " + Fixed(pass->limit_mm, 3) + " mm and " +
                   Fixed(pass->limit_deg, 3) + " degrees",
               kMovedTube);
  }
  if (in.nominal_pipe_radius_mm) {
    const double nominal_mm = *in.nominal_pipe_radius_mm;
    const double limit_mm = options.most_pipe_radius_deviation * nominal_mm;
    const double off_mm = std::abs(in.pipe_radius_mm - nominal_mm);
    const double ratio = in.pipe_radius_mm / nominal_mm;
    const bool units = ratio > 20 || ratio < 0.05;
    checks.Add(InterlockKind::kPipeRadius, off_mm <= limit_mm, off_mm, limit_mm,
               "pipe radius measured " + Fixed(in.pipe_radius_mm, 3) + " mm, nominal " +
                   Fixed(nominal_mm, 3) + " mm, limit " + Fixed(limit_mm, 3) + " mm apart",
               units ? "check the units (mm, m or inch) of scan and part file"
                     : "wrong tube, or diameter entered as radius");
  }
  const double all = static_cast<double>(in.profiles) + static_cast<double>(in.profiles_lost);
  const double lost = all > 0 ? static_cast<double>(in.profiles_lost) / all : 0.0;
  checks.Add(InterlockKind::kLostProfiles, lost <= options.most_lost_profiles, 100 * lost,
             100 * options.most_lost_profiles,
             std::to_string(in.profiles_lost) + " profiles lost, " + Fixed(100 * lost, 2) +
                 " % of all, limit " + Fixed(100 * options.most_lost_profiles, 2) + " %",
             "check cable, queue and load of the machine, and scan again");
}

// From here on [mm, degrees] a number says no more than that nothing is known.
constexpr double kUnknownSigma = 1000.0;

// Of one axis: the row whose sigma is largest, and whether any is known well enough.
struct WorstSigma {
  double sigma = -1;
  std::string name;
  bool any_known = false;

  void Take(double value, double limit, const std::string& of) {
    any_known = any_known || value <= limit;
    // NaN is the worst of all.
    if (std::isnan(sigma) || (!std::isnan(value) && value <= sigma)) return;
    sigma = value;
    name = of;
  }
};

// A row that is not known well enough is held by itself (limits.h) and weighs little in what is
// learnt; a tube of which nothing is known is refused.
void CheckSigma(const InterlockInput& in, const InterlockOptions& options, Checks& checks) {
  WorstSigma length;
  WorstSigma rotation;
  WorstSigma angle;
  const PerAxis& limits = options.most_sigma;
  const auto& rows = in.measured.rows;
  const std::size_t bends = in.measured.bend_count();
  const bool known = in.sigma.rows.size() == rows.size() && !rows.empty();
  for (std::size_t i = 0; known && i < rows.size(); ++i) {
    length.Take(in.sigma.rows[i].length_mm, limits.length_mm, LengthName(i, bends));
    if (i == bends) break;
    angle.Take(in.sigma.rows[i].angle_deg, limits.angle_deg, AngleName(i));
    if (i > 0 && std::min(rows[i - 1].angle_deg, rows[i].angle_deg) >= options.least_angle_deg) {
      rotation.Take(in.sigma.rows[i].rotation_deg, limits.rotation_deg, RotationName(i));
    }
  }
  const bool any_known = length.any_known || rotation.any_known || angle.any_known;
  const auto add = [&](InterlockKind kind, const WorstSigma& worst, double limit, const char* axis,
                       const char* unit) {
    if (!known) {
      checks.Add(kind, false, kNoNumber, limit,
                 std::string("no uncertainty of the ") + axis + " is known",
                 "nothing is corrected on numbers without one");
      return;
    }
    if (worst.name.empty()) return;  // the tube has no such number
    const bool is_held = !(worst.sigma <= limit);
    std::string found =
        worst.name +
        (worst.sigma < kUnknownSigma ? " is known to " + Fixed(worst.sigma, 3) + " " + unit +
                                           " (1 sigma, the worst " + axis + ")"
                                     : std::string(" is not known at all")) +
        ", limit " + Fixed(limit, 3) + " " + unit;
    if (is_held && any_known) found += "; held by itself until the lot knows it";
    checks.Add(kind, any_known, worst.sigma, limit, found,
               "nothing of this tube is known well enough: scan it again, slower or from more "
               "sides");
  };
  add(InterlockKind::kUncertaintyLength, length, limits.length_mm, "length", "mm");
  add(InterlockKind::kUncertaintyRotation, rotation, limits.rotation_deg, "rotation", "degrees");
  add(InterlockKind::kUncertaintyAngle, angle, limits.angle_deg, "angle", "degrees");
}

void CheckCorrection(const InterlockInput& in, Checks& checks) {
  if (!in.correction) {
    checks.Add(
        InterlockKind::kCorrection, !in.sends, kNoNumber, kNoNumber, "there is no correction",
        "the part could not be compared with the nominal, or the program that bent it is not "
        "known");
    return;
  }
  const Correction& correction = *in.correction;
  // One entry for each refusal; row, value and limit stand in its sentence.
  for (const std::string& refusal : correction.refusals) {
    checks.Add(InterlockKind::kCorrection, false, kNoNumber, kNoNumber, "correction of " + refusal,
               "nothing is sent");
  }
  if (!correction.refused()) {
    checks.Add(InterlockKind::kCorrection, true, 0, 0,
               correction.changes_anything ? "the correction is within its limits"
                                           : "nothing needs to be corrected",
               "");
  }
}

void CheckSession(const InterlockInput& in, const InterlockOptions& options, Checks& checks) {
  checks.Add(InterlockKind::kStaleSession,
             in.session_age_s >= 0 && in.session_age_s <= options.oldest_session_s,
             in.session_age_s, options.oldest_session_s,
             "the scan ended " + Fixed(in.session_age_s, 0) + " s ago, limit " +
                 Fixed(options.oldest_session_s, 0) + " s",
             "the bender may have moved on; scan a part of its present program");
  checks.Add(InterlockKind::kUsedSession, !in.session_used, in.session_used ? 1 : 0, 0,
             in.session_used ? "this scan has already led to a committed program"
                             : "this scan has not been used yet",
             "the same deviation must not be corrected twice; scan the next part");
}

void CheckTube(const InterlockInput& in, Checks& checks) {
  for (const TubeCheck& check : in.tube) {
    checks.Add(check.kind, check.passed, kNoNumber, kNoNumber, check.found, check.mend);
  }
  // Without a program there is nothing to compare, which its own check says.
  if (!in.part_number || in.bent_with.program.rows.empty()) return;
  const std::uint32_t bent = in.bent_with.part_number;
  checks.Add(InterlockKind::kPartNumber, bent == *in.part_number, bent, *in.part_number,
             "the tube was bent by a program of part " + std::to_string(bent) +
                 ", this cell makes part " + std::to_string(*in.part_number),
             "another part is set up at the bender; give the cell file its part, or load the "
             "program of this one");
}

std::string BentWithText(const hal::ProgramBlock& bent, const hal::ProgramBlock& expected) {
  if (bent.program.rows.empty()) return ", which program bent this part is not known";
  std::string text = ", this part was bent with part " + std::to_string(bent.part_number) +
                     " sequence " + std::to_string(bent.sequence);
  if (expected.sequence == bent.sequence) return text;
  return text + ", corrected since to sequence " + std::to_string(expected.sequence);
}

void CheckBender(const InterlockInput& in, Checks& checks) {
  if (!in.bender) {
    checks.Add(InterlockKind::kBenderReady, false, kNoNumber, kNoNumber,
               "the bender's state is not known", "check the link and that the controller runs");
    checks.Add(InterlockKind::kActiveProgram, false, kNoNumber, kNoNumber,
               "the bender's active program is not known", "check the link");
    return;
  }
  const hal::BenderState& state = in.bender->state;
  const char* mode = "idle";
  const char* mend = "";
  switch (state.mode) {
    case hal::BenderMode::kIdle:
      break;
    case hal::BenderMode::kNotReady:
      mode = "not ready";
      mend = "switch it on, home it, close the guard";
      break;
    case hal::BenderMode::kBending:
      mode = "bending";
      mend = "wait for the end of the cycle";
      break;
    case hal::BenderMode::kFault:
      mode = "in fault";
      mend = "clear the fault at the bender";
      break;
  }
  std::string found = std::string("the bender is ") + mode;
  if (state.mode == hal::BenderMode::kFault) {
    found += " (code " + std::to_string(state.fault_code) + ")";
  }
  checks.Add(InterlockKind::kBenderReady, state.mode == hal::BenderMode::kIdle,
             static_cast<double>(state.mode), static_cast<double>(hal::BenderMode::kIdle), found,
             mend);

  const hal::ProgramBlock& active = in.bender->active;
  const hal::ProgramBlock& expected = in.expected ? *in.expected : in.bent_with;
  const bool same_part = active.part_number == expected.part_number &&
                         state.active_part_number == expected.part_number;
  const bool same_sequence =
      active.sequence == expected.sequence && state.active_sequence == expected.sequence;
  const bool same_rows = SameRows(active.program, expected.program);
  const auto name = [](std::uint32_t part, std::uint32_t sequence) {
    return "part " + std::to_string(part) + " sequence " + std::to_string(sequence);
  };
  std::string text = "the active program is " + name(active.part_number, active.sequence);
  if (active.part_number != state.active_part_number || active.sequence != state.active_sequence) {
    text += " (its state says " + name(state.active_part_number, state.active_sequence) + ")";
  }
  text += BentWithText(in.bent_with, expected);
  if (same_part && same_sequence && !same_rows) text += ", but the rows differ";
  checks.Add(InterlockKind::kActiveProgram, same_part && same_sequence && same_rows,
             same_part ? active.sequence : active.part_number,
             same_part ? expected.sequence : expected.part_number, text,
             "the program was changed since the part was bent; bend and scan a part of the "
             "active one");
}

}  // namespace

std::string_view Name(InterlockKind kind) {
  switch (kind) {
    case InterlockKind::kBendCount:
      return "bend count";
    case InterlockKind::kDirection:
      return "direction";
    case InterlockKind::kCoverage:
      return "coverage";
    case InterlockKind::kGap:
      return "gap";
    case InterlockKind::kFit:
      return "fit";
    case InterlockKind::kPasses:
      return "passes";
    case InterlockKind::kPipeRadius:
      return "pipe radius";
    case InterlockKind::kLostProfiles:
      return "lost profiles";
    case InterlockKind::kUncertaintyLength:
      return "uncertainty length";
    case InterlockKind::kUncertaintyRotation:
      return "uncertainty rotation";
    case InterlockKind::kUncertaintyAngle:
      return "uncertainty angle";
    case InterlockKind::kCorrection:
      return "correction";
    case InterlockKind::kStaleSession:
      return "stale session";
    case InterlockKind::kUsedSession:
      return "used session";
    case InterlockKind::kNewTube:
      return "new tube";
    case InterlockKind::kTubeCount:
      return "tube count";
    case InterlockKind::kTubeProgram:
      return "tube program";
    case InterlockKind::kTubeIdentity:
      return "tube identity";
    case InterlockKind::kPartNumber:
      return "part number";
    case InterlockKind::kBenderReady:
      return "bender ready";
    case InterlockKind::kActiveProgram:
      return "active program";
  }
  return "unknown";
}

bool InterlockReport::passed() const {
  return !checks.empty() && std::all_of(checks.begin(), checks.end(),
                                        [](const Interlock& check) { return check.passed; });
}

std::vector<std::string> InterlockReport::refusals() const {
  std::vector<std::string> sentences;
  for (const Interlock& check : checks) {
    if (!check.passed) sentences.push_back(check.sentence);
  }
  return sentences;
}

InterlockReport CheckInterlocks(const InterlockInput& input, const InterlockOptions& options) {
  InterlockReport report;
  Checks checks(report);
  CheckScan(input, options, checks);
  CheckSigma(input, options, checks);
  CheckCorrection(input, checks);
  CheckSession(input, options, checks);
  if (input.sends) {
    CheckTube(input, checks);
    CheckBender(input, checks);
  }
  return report;
}

}  // namespace bendloop::pipeline
