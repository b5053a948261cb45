// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

namespace bendloop::pipeline {

// How far a tube that a machine bent may lie beside lines and arcs: the model knows that it is a
// model. Straights are bowed, bends ease in and out, dents push the fitted line aside. However many
// samples there are, and however exact: what they say of a place of the spine is never worth more
// than this.
struct FormDeviation {
  // 1 sigma of the spine across itself, over a pipe radius of its length, in pipe radii. Bends that
  // ease over half a pipe radius and dents of a tenth leave as much beside the best lines and arcs;
  // with half of it they are taken for bends, with twice bends of a degree are lost (Monte Carlo,
  // real kinds).
  double across = 0.009;
  // 1 sigma of a straight's bow, its height over its length. EN 10305-1 lets precision tube deviate
  // by 0.0015 of its length; a bender's clamp adds to that or takes from it.
  double bow = 0.001;

  double AcrossMm(double pipe_radius_mm) const { return across * pipe_radius_mm; }
  // So uncertain is each of `samples` on `length_mm` of spine at least, that together they tell no
  // more: a sample sees half of the two directions across.
  double LeastVariance(double samples, double length_mm, double pipe_radius_mm) const {
    const double per_radius = samples * pipe_radius_mm / std::max(length_mm, pipe_radius_mm);
    const double across_mm = AcrossMm(pipe_radius_mm);
    return 0.5 * per_radius * across_mm * across_mm;
  }
};

}  // namespace bendloop::pipeline
