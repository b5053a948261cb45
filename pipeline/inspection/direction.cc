// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/direction.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "pipeline/math/text.h"
#include "pipeline/tube/alignment.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {
namespace {

// How much rotations count beside small bends. By trial.
struct RotationWeights {
  // [degrees] Below this angle a bend's normal, and so the rotation, becomes uncertain in
  // proportion.
  double full_normal_deg = 10.0;
  // Rotations of less weight say nothing: a bend of half a degree has no direction.
  double least = 0.05;
};
constexpr RotationWeights kRotation;

hal::BendProgram Mirrored(hal::BendProgram program) {
  for (hal::BendRow& row : program.rows) row.rotation_deg = -row.rotation_deg;
  return program;
}

class Cost {
 public:
  explicit Cost(DirectionFit& fit) : fit_(fit) {}
  void Add(std::size_t row, double difference, double expected, double sigma) {
    const double scale = std::hypot(expected, std::isfinite(sigma) ? sigma : 0.0);
    double z = difference == 0 ? 0.0 : std::abs(difference) / scale;
    if (!std::isfinite(z)) z = 1e6;  // a number that is none never fits
    fit_.cost += z * z;
    if (z > fit_.worst) {
      fit_.worst = z;
      fit_.worst_row = row;
    }
    ++count_;
  }
  void Finish() { fit_.rms = count_ > 0 ? std::sqrt(fit_.cost / count_) : 0; }

 private:
  DirectionFit& fit_;
  int count_ = 0;
};

// Both programs have the same number of rows.
DirectionFit FitOneWay(const hal::BendProgram& nominal, const hal::BendProgram& measured,
                       const hal::BendProgram& sigma, const DirectionOptions& options) {
  DirectionFit fit;
  Cost cost(fit);
  const std::size_t bends = nominal.bend_count();
  for (std::size_t i = 0; i <= bends; ++i) {
    const hal::BendRow& n = nominal.rows[i];
    const hal::BendRow& m = measured.rows[i];
    const hal::BendRow s = i < sigma.rows.size() ? sigma.rows[i] : hal::BendRow{};
    const hal::BendRow expected = ExpectedVariation(nominal, i, options.expected);
    cost.Add(i, m.length_mm - n.length_mm, expected.length_mm, s.length_mm);
    if (i == bends) break;
    cost.Add(i, m.angle_deg - n.angle_deg, expected.angle_deg, s.angle_deg);
    if (n.bend_radius_mm && m.bend_radius_mm) {
      cost.Add(i, *m.bend_radius_mm - *n.bend_radius_mm, *expected.bend_radius_mm,
               s.bend_radius_mm.value_or(0.0));
    }
    if (i == 0) continue;
    const double smallest = std::min(
        {n.angle_deg, nominal.rows[i - 1].angle_deg, m.angle_deg, measured.rows[i - 1].angle_deg});
    const double weight = std::min(1.0, smallest / kRotation.full_normal_deg);
    if (weight < kRotation.least) continue;
    cost.Add(i, hal::WrapRotationDeg(m.rotation_deg - n.rotation_deg),
             expected.rotation_deg / weight, s.rotation_deg);
  }
  cost.Finish();
  const auto knots_N = Knots(nominal, {});
  const auto knots_W = Knots(measured, {});
  const std::vector<double> weights(knots_N.size(), 1.0);
  fit.residual_mm = BestFit(knots_W, knots_N, weights).rms_mm;
  fit.plausible = fit.worst <= options.plausible_row && fit.rms <= options.plausible_rms;
  return fit;
}

std::string Differs(const DirectionFit& fit) {
  return "row " + std::to_string(fit.worst_row + 1) + " is " + Fixed(fit.worst, 1) +
         " expected variations off";
}

// Says why neither way round is this part. `mirrored`: against the mirror image of the nominal.
void Refuse(const DirectionFit& mirrored, const DirectionOptions& options, DirectionMatch& match) {
  const DirectionFit& chosen = match.reversed ? match.reverse : match.forward;
  const DirectionFit& other = match.reversed ? match.forward : match.reverse;
  match.state = DirectionState::kNoMatch;
  if (other.plausible) {
    match.message = std::string("the tube fits only when measured ") +
                    (match.reversed ? "from the nominal's start" : "from the nominal's end") +
                    ", but the cell's direction says the other end (" + Differs(chosen) +
                    "): turn the tube or correct the direction in the cell file";
  } else if (mirrored.plausible &&
             std::min(chosen.cost, other.cost) - mirrored.cost > options.decisive_difference) {
    match.state = DirectionState::kMirrored;
    match.message =
        "the tube is the mirror image of the nominal (the sign of every rotation is opposite): "
        "wrong hand of the part, or the rotation sign of the program is not ours";
  } else {
    match.message = "this is not the part: " + Differs(chosen) +
                    " even the better way round (rotations, lengths and angles of the nominal "
                    "against the scan)";
  }
}

}  // namespace

std::string_view Name(DirectionState state) {
  switch (state) {
    case DirectionState::kForward:
      return "forward";
    case DirectionState::kReverse:
      return "reverse";
    case DirectionState::kAmbiguous:
      return "ambiguous";
    case DirectionState::kWrongBends:
      return "wrong number of bends";
    case DirectionState::kMirrored:
      return "mirrored";
    case DirectionState::kNoMatch:
      return "no match";
  }
  return "unknown";
}

DirectionMatch MatchDirection(const hal::BendProgram& nominal, const hal::BendProgram& measured,
                              const hal::BendProgram& sigma, const DirectionOptions& options) {
  DirectionMatch match;
  if (nominal.rows.size() != measured.rows.size() || nominal.rows.empty()) {
    match.state = DirectionState::kWrongBends;
    match.message = "measured " + std::to_string(measured.bend_count()) +
                    " bends, the nominal has " + std::to_string(nominal.bend_count()) +
                    ": wrong part, or part of it was not scanned";
    return match;
  }
  const hal::BendProgram turned = ReverseProgram(measured);
  const hal::BendProgram turned_sigma =
      sigma.rows.size() == measured.rows.size() ? ReverseProgram(sigma) : hal::BendProgram{};
  match.forward = FitOneWay(nominal, measured, sigma, options);
  match.reverse = FitOneWay(nominal, turned, turned_sigma, options);
  const bool is_auto = options.choice == DirectionChoice::kAuto;
  match.reversed = is_auto ? match.reverse.cost < match.forward.cost
                           : options.choice == DirectionChoice::kReverse;
  const DirectionFit& chosen = match.reversed ? match.reverse : match.forward;
  const DirectionFit& other = match.reversed ? match.forward : match.reverse;
  const char* const way = match.reversed ? "from the nominal's end" : "from the nominal's start";

  if (!chosen.plausible) {
    const hal::BendProgram mirrored = Mirrored(nominal);
    const DirectionFit forward = FitOneWay(mirrored, measured, sigma, options);
    const DirectionFit reverse = FitOneWay(mirrored, turned, turned_sigma, options);
    Refuse(reverse.cost < forward.cost ? reverse : forward, options, match);
    return match;
  }
  // A tube without bends is the same from both ends: nothing can be mistaken.
  const bool decisive = other.cost - chosen.cost >= options.decisive_difference &&
                        other.residual_mm >= chosen.residual_mm;
  if (is_auto && !decisive && nominal.bend_count() > 0) {
    match.state = DirectionState::kAmbiguous;
    match.message = "the part looks nearly the same from both ends (rows differ by at most " +
                    Fixed(match.forward.worst, 1) + " expected variations forward and " +
                    Fixed(match.reverse.worst, 1) +
                    " reversed): which end is bent first? Set the scan's direction to \"forward\" "
                    "or \"reverse\" in the cell file";
    return match;
  }
  match.state = match.reversed ? DirectionState::kReverse : DirectionState::kForward;
  match.message = std::string("measured ") + way + ", rows differ by at most " +
                  Fixed(chosen.worst, 1) + " expected variations";
  return match;
}

}  // namespace bendloop::pipeline
