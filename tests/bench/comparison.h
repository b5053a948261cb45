// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "hal/bend_program.h"
#include "hal/tube.h"
#include "pipeline/tube/measurement.h"
#include "tests/bench/cramer_rao.h"

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

// Errors of interior lengths, rotations, angles and radii in units of something.
struct LraRatios {
  Ratio length, rotation, angle, bend_radius, pipe_radius;
  void Add(const LraRatios& other);
};

struct Comparison {
  bool bends_right = false;
  LraRatios over_sigma;  // what the measurement says of itself
  LraRatios over_bound;  // the Cramer-Rao bound
  LraRatios plain;       // mm and degrees
  Ratio ends_over_spacing, ends_over_sigma;
  Ratio vague;  // values that the points hardly determine, over sigma; in none of the others
  double worst_over_bound = 0;
  double worst_over_sigma = 0;  // the ends too
  std::string worst_of_sigma;   // which: "L3"
  // The same one by one, always in the same order for the same tube.
  struct Value {
    Ratio LraRatios::*kind;
    double error, bound;
    bool vague;
  };
  std::vector<Value> values;
};

// `measured` may have been found from its other end: the better way round counts. Errors are
// compared only when the number of bends is right. What even the best estimate would not know to a
// sixth (a bend's radius), 5 degrees or half a pipe radius is counted as vague: there a standard
// deviation says little.
Comparison Compare(const hal::Tube& truth, const pipeline::Measurement& measured,
                   const Bound& bound, double spacing_mm);

}  // namespace bendloop::bench
