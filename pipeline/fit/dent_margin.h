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

// By trial, for what is decided about a tube whose bends are known; where bends are still looked
// for as much hides them. Of a deep dent in a bend what lies beyond three r_P still moves its
// radius.
inline constexpr DentMargin kWideDentMargin{.wide = 1.5, .as_seen = 4.0};

}  // namespace bendloop::pipeline
