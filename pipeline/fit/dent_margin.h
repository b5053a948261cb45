// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::pipeline {

// How much of the surface is left out about a dent: a circle so many times as wide as what it takes
// [of r_P].
struct DentMargin {
  double wide = 1.0;
  double most = 3.0;     // no wider: half the turn
  double as_seen = 3.0;  // but where the dent, as it is seen, is wider itself
};

}  // namespace bendloop::pipeline
