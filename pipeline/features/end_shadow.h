// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "pipeline/features/end_evidence.h"
#include "pipeline/features/end_lines.h"
#include "pipeline/features/end_sectors.h"
#include "pipeline/features/posterior.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// An end of which one side lies in shadow, as the tube's own is where a scan saw it from a few
// sides: samples stop at the cut on some of its turn, and before it, anywhere, on the rest. A plane
// through all that would be steep and end at the middle between both.
//
// Which it is tell columns along the tube (end_columns.h): those that a cut ends stop at its plane
// all round, to their gaps. One that stops before a plane by more may be hidden, which is as
// unlikely as a stop anywhere in its window is; one that goes on beyond a plane denies it. The
// likeliest plane of this kind is sought among those through three columns, and square ones.
struct ShadowedEnd {
  Posterior plane;  // as a plane's numbers are (EndSide), in mm
  double seen = 0;  // part of the turn on which samples stop at it
  // The logarithm of how much likelier it is than what it was compared with, by so many columns.
  double likelier = 0, columns = 0;
};

// What is known of an end before a shadow is thought of.
struct EndInDoubt {
  double pipe_radius_mm = 0, window_mm = 0;
  double smear_mm = 0;                  // 1 sigma by which noise displaces samples
  Eigen::Vector3d plane_mm;             // where samples were taken to stop
  std::span<const BorderPlace> border;  // beyond it; none: they stop at it
  int terms = 3;                        // numbers that this takes
};

// None: samples say too little.
std::optional<ShadowedEnd> FindEndInShadow(std::span<const EndSample> samples,
                                           const EndInDoubt& doubt, WalkDice& dice);

// Where columns stop before a plane, neighbours with each other, by more than their gaps are long,
// or show no samples. `slope_mm`: that the columns count from.
EndSectors SectorsInShadow(const EndEvidence& columns, const Eigen::Vector2d& slope_mm,
                           const Eigen::Vector3d& plane_mm);

}  // namespace bendloop::pipeline
