// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "pipeline/spine/oriented_samples.h"
#include "pipeline/spine/spine_node.h"

namespace bendloop::pipeline {

struct ShrinkingOptions {
  double radius_mm = 0;  // about the pipe's; the unit of all lengths below
  double step = 0.1;     // delta
  double meet = 0.1;     // R: samples closer than this meet
  // Samples meet when the cosine between their normals is below this (tau). The paper has 0 for
  // pipes and cos 80 degrees for canal surfaces; cos 60 degrees lets samples meet that were scanned
  // from one side, where nothing lies opposite.
  double cosine = 0.5;
  double most = 1.6;     // how far a sample is moved at most; varying radius: 3
  double support = 1.0;  // H, of the moving least squares
};

struct ShrunkSpine {
  std::vector<SpineNode> nodes;  // thin, with local radius
  double pipe_radius_mm = 0;     // mean distance of the samples from the spine; 0: nothing met
  double met = 0;                // part of the samples that met others, 0..1
  int steps = 0;
};

// Moves all samples inward by the same distance, step by step, until the number of samples that
// meet others from another side of the pipe has passed its peak: there the set is thinnest. (The
// paper stops at the first step where it exceeds a share mu of the samples, which is half a step to
// R too early, and of which a scan from one side need not have enough.) Then moving least squares
// make it a curve. Source: Lee & Kim 2004, section 2 (algorithm 1, equations 2 to 6).
ShrunkSpine ShrinkPipe(std::span<const OrientedSample> samples, const ShrinkingOptions& options);

// The same for a varying radius: each sample stops where it meets others.
// Source: Lee & Kim 2004, section 3 (algorithm 2).
ShrunkSpine ShrinkCanal(std::span<const OrientedSample> samples, const ShrinkingOptions& options);

}  // namespace bendloop::pipeline
