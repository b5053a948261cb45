// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "pipeline/features/end_lines.h"
#include "pipeline/features/end_sectors.h"
#include "pipeline/features/posterior.h"

namespace bendloop::pipeline {

// A border that samples are too few to follow in all that it does: a series of how far around it is
// (end_series.h), and how far it lies beside that, 1 sigma.
struct RaggedBorder {
  Posterior series;  // as it counts from the plane that was asked
  double ragged_mm = 0;
  // Whether it is ragged on each third of the turn: one side of it in shadow is none.
  bool all_round = false;
};

// What is known of an end whose border no plane is.
struct RaggedAbout {
  Eigen::Vector3d plane_mm = Eigen::Vector3d::Zero();  // a plane about there
  double window_mm = 0;                                // samples are of so much before it
  double smear_mm = 0;                                 // noise along the tube, 1 sigma
  EndSectors hidden{};                                 // where samples stop at something else
};

// Whether samples are missing right before a plane, more than chance and noise leave away.
bool MissesSamplesBefore(std::span<const EndSample> samples, const RaggedAbout& about,
                         double pipe_radius_mm);

// The same on each third of the turn: the plane is that of no cut, of which any part is hidden.
bool MissesSamplesAllRound(std::span<const EndSample> samples, const RaggedAbout& about,
                           double pipe_radius_mm);

// Scattered samples are a Poisson process that ends at the border; where that is ragged their
// density falls as if noise moved them by as much. The likeliest series and raggedness, each sector
// of the turn with a density of its own; as many terms as the samples pay for (Bayesian information
// criterion). The first three terms are the plane nearest to the border all round, however ragged
// it is. None: the plane with its noise alone explains them, or too little of the turn is seen.
std::optional<RaggedBorder> FitRaggedBorder(std::span<const EndSample> samples,
                                            const RaggedAbout& about, double pipe_radius_mm);

}  // namespace bendloop::pipeline
