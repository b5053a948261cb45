// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>

#include "hal/spine.h"
#include "hal/tube.h"
#include "pipeline/tube/measurement.h"

// Tubes that could come from a drawing, and measurements of them without a scanner.
namespace bendloop::support {

using Rng = std::mt19937_64;

inline double Uniform(Rng& rng, double from, double to) {
  return std::uniform_real_distribution<double>(from, to)(rng);
}

inline double Gauss(Rng& rng, double sigma) {
  return sigma > 0 ? std::normal_distribution<double>(0.0, sigma)(rng) : 0.0;
}

inline hal::Pose RandomPose(Rng& rng) {
  hal::Pose pose;
  pose.position_mm = {Uniform(rng, -500, 500), Uniform(rng, -500, 500), Uniform(rng, -500, 500)};
  pose.orientation =
      Eigen::Quaterniond(Gauss(rng, 1), Gauss(rng, 1), Gauss(rng, 1), Gauss(rng, 1)).normalized();
  return pose;
}

// Straights of 30 to 200 mm, angles of 15 to 150 degrees, one bend radius.
inline hal::BendProgram RandomProgram(Rng& rng, int bends) {
  const double bend_radius_mm = Uniform(rng, 20, 60);
  hal::BendProgram program;
  for (int i = 0; i <= bends; ++i) {
    hal::BendRow row;
    row.length_mm = Uniform(rng, 30, 200);
    if (i < bends) {
      row.rotation_deg = i == 0 ? 0.0 : Uniform(rng, -180, 180);
      row.angle_deg = Uniform(rng, 15, 150);
      row.bend_radius_mm = bend_radius_mm;
    }
    program.rows.push_back(row);
  }
  return program;
}

inline hal::BendProgram ConstantSigma(const hal::BendProgram& program, double length_mm,
                                      double rotation_deg, double angle_deg) {
  hal::BendProgram sigma = program;
  for (std::size_t i = 0; i < sigma.rows.size(); ++i) {
    const bool bend = i + 1 < sigma.rows.size();
    sigma.rows[i] = {length_mm, bend && i > 0 ? rotation_deg : 0.0, bend ? angle_deg : 0.0,
                     std::nullopt};
    if (bend) sigma.rows[i].bend_radius_mm = 0.05;
  }
  return sigma;
}

// A perfect measurement of `tube`, with samples all over its surface.
inline pipeline::Measurement MeasurementOf(const hal::Tube& tube, Rng& rng,
                                           std::size_t samples = 400, double noise_mm = 0) {
  pipeline::Measurement measurement;
  measurement.tube = tube;
  measurement.sigma = ConstantSigma(tube.program, 0.02, 0.02, 0.02);
  measurement.noise_mm = noise_mm;
  measurement.coverage = 1;
  measurement.fit.samples = samples;
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const double length_mm = hal::SpineLength(tube.program);
  for (std::size_t i = 0; i < samples; ++i) {
    const double along_mm = Uniform(rng, 0, length_mm);
    auto segment = segments.begin();
    while (segment + 1 != segments.end() && (segment + 1)->from_start_mm <= along_mm) ++segment;
    const double on_segment_mm = along_mm - segment->from_start_mm;
    const Eigen::Vector3d tangent = segment->TangentAt(on_segment_mm);
    const Eigen::Vector3d side = segment->normal;
    const Eigen::AngleAxisd turn(Uniform(rng, 0, 2 * std::numbers::pi), tangent);
    measurement.surface.push_back({segment->PointAt(on_segment_mm) +
                                       (tube.pipe_radius_mm + Gauss(rng, noise_mm)) * (turn * side),
                                   0.0});
  }
  return measurement;
}

}  // namespace bendloop::support
