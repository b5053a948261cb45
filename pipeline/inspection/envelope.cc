// SPDX-License-Identifier: Apache-2.0
#include "pipeline/inspection/envelope.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "hal/spine.h"
#include "pipeline/tube/spine_distance.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

std::string KnotName(std::size_t knot, std::size_t knots) {
  if (knot == 0) return "start";
  if (knot + 1 == knots) return "end";
  return "bend " + std::to_string((knot + 1) / 2) + (knot % 2 == 1 ? " entry" : " exit");
}

std::vector<double> Distances(const SpineDistance& axis, const std::vector<Vector3d>& knots_W,
                              const hal::Pose& X_NW) {
  std::vector<double> distances;
  distances.reserve(knots_W.size());
  for (const Vector3d& knot_W : knots_W) distances.push_back(axis(X_NW * knot_W));
  return distances;
}

}  // namespace

std::vector<EnvelopePoint> Envelope(const hal::BendProgram& nominal, const hal::Tube& measured,
                                    const hal::BendProgram& sigma, const Alignment& alignment,
                                    std::optional<double> tolerance_mm, double decision_sigmas) {
  // Long enough that no end is measured from the nominal's end point instead of its axis.
  const double extend_mm = hal::SpineLength(nominal) + hal::SpineLength(measured.program);
  const SpineDistance axis(hal::SpineSegments(nominal, {}), extend_mm);
  const auto knots_N = Knots(nominal, {});
  const auto knots_W = Knots(measured.program, measured.X_WT);
  const auto distances = Distances(axis, knots_W, alignment.X_NW);

  // One row's number moved by its sigma at a time, and aligned again.
  std::vector<double> variances(knots_W.size(), 0.0);
  const std::size_t rows = std::min(sigma.rows.size(), measured.program.rows.size());
  for (std::size_t i = 0; i < rows; ++i) {
    for (const auto& [member, step] : {std::pair{&hal::BendRow::length_mm, sigma.rows[i].length_mm},
                                       {&hal::BendRow::rotation_deg, sigma.rows[i].rotation_deg},
                                       {&hal::BendRow::angle_deg, sigma.rows[i].angle_deg}}) {
      if (step == 0) continue;
      hal::Tube moved = measured;
      moved.program.rows[i].*member += step;
      const auto moved_distances =
          Distances(axis, Knots(moved.program, moved.X_WT), AlignTubes(nominal, moved).X_NW);
      for (std::size_t k = 0; k < variances.size(); ++k) {
        variances[k] += (moved_distances[k] - distances[k]) * (moved_distances[k] - distances[k]);
      }
    }
  }

  std::vector<EnvelopePoint> envelope;
  for (std::size_t k = 0; k < std::min(knots_N.size(), knots_W.size()); ++k) {
    EnvelopePoint point;
    point.name = KnotName(k, knots_W.size());
    point.nominal_mm = knots_N[k];
    point.measured_mm = alignment.X_NW * knots_W[k];
    point.distance_mm = distances[k];
    point.sigma_mm = std::sqrt(variances[k]);
    point.state = Judge(point.distance_mm, point.sigma_mm, tolerance_mm, decision_sigmas);
    envelope.push_back(point);
  }
  return envelope;
}

}  // namespace bendloop::pipeline
