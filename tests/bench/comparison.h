// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/bend_program.h"
#include "hal/tube.h"
#include "pipeline/measurement.h"

namespace bendloop::bench {

// Mean squares of one kind of value over many tubes.
struct Ratio {
  double sum2 = 0;
  int count = 0;
  void Add(double ratio) {
    sum2 += ratio * ratio;
    ++count;
  }
  void Add(const Ratio& other) {
    sum2 += other.sum2;
    count += other.count;
  }
  double Rms() const;
};

// Errors of interior lengths, rotations and angles in units of something.
struct LraRatios {
  Ratio length, rotation, angle;
  void Add(const LraRatios& other);
};

struct Comparison {
  bool bends_right = false;
  LraRatios over_sigma;  // what the measurement says of itself
  LraRatios over_bound;  // the Cramer-Rao bound
  LraRatios plain;       // mm and degrees
  Ratio ends_over_spacing;
};

// `measured` may have been found from its other end: the better way round counts. Errors are
// compared only when the number of bends is right.
Comparison Compare(const hal::Tube& truth, const pipeline::Measurement& measured,
                   const hal::BendProgram& bound, double spacing_mm);

}  // namespace bendloop::bench
