// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>

#include "hal/bend_program.h"
#include "hal/clock.h"
#include "hal/laser_profile.h"
#include "hal/result.h"
#include "pipeline/math/workers.h"
#include "pipeline/spine/spine_method.h"
#include "pipeline/tube/measurement.h"
#include "pipeline/tube/pass_offsets.h"

namespace bendloop::pipeline {

struct ReconstructionOptions {
  // Known pipe radius [mm]; estimated from the samples when empty.
  std::optional<double> pipe_radius_mm;
  // The tube that the samples should show, in any pose: says which of several pieces is the tube,
  // and how many bends it has where the samples leave that open; never how large they are.
  std::optional<hal::BendProgram> nominal;
  // Of the points that come to a place again and again so many are kept for the final fit, evenly
  // over the scan: memory and the final fit are bounded by this and by the tube.
  std::size_t max_points = 4'000'000;
  // Where there are more, of the laser lines so many for the features, as lines.
  std::size_t max_line_points = 1'000'000;
  // By how much the passes of a scan may lie beside each other. Of clouds nothing is known.
  PassDrift pass_drift = {};
  // For the final result; the live view always projects with moving least squares.
  SpineMethod spine_method = SpineMethod::kMls;
};

// What is known of a tube while its scan still runs.
struct LiveView {
  std::uint64_t profiles = 0;
  std::uint64_t points = 0;       // received
  std::size_t spine_samples = 0;  // projected so far
  double covered_mm = 0;          // length of spine seen so far
  double pipe_radius_mm = 0;      // 0: not yet known
  hal::BendProgram program;       // live LRA of the part seen so far; may be empty
  hal::BendProgram sigma;         // same shape
};

// Points in, tube out: the paper's method (Bauer & Polthier 2009, section 1.3) on samples as they
// arrive. Not thread-safe; deterministic in the order of the profiles.
class Reconstruction {
 public:
  // `clock` times the stages and nothing else.
  Reconstruction(const ReconstructionOptions& options, const hal::Clock& clock);
  ~Reconstruction();
  Reconstruction(Reconstruction&&) noexcept;
  Reconstruction& operator=(Reconstruction&&) noexcept;

  // Takes a profile's points to the world frame and projects what has become complete.
  void Add(const hal::LaserProfile& profile);
  // The same for points that already are in the world frame [mm].
  void Add(std::span<const Eigen::Vector3d> points_W);
  // Cheap enough for several calls a second.
  LiveView View() const;
  // The final fit. kBadInput when the points are no tube: says what they look like instead.
  // `workers` share its loops; none: the caller does all of it. The result does not depend on them.
  hal::Result<Measurement> Finish(Workers* workers = nullptr);

 private:
  friend hal::Result<Measurement> Reconstruct(std::span<const Eigen::Vector3d>,
                                              const ReconstructionOptions&, const hal::Clock&,
                                              Workers*);
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// Batch is the live pipeline fed at once.
hal::Result<Measurement> Reconstruct(std::span<const Eigen::Vector3d> points_W,
                                     const ReconstructionOptions& options, const hal::Clock& clock,
                                     Workers* workers = nullptr);

}  // namespace bendloop::pipeline
