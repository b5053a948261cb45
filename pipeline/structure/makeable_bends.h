// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "pipeline/fit/surface_fit.h"

namespace bendloop::pipeline {

// How many of a tube's bends a machine has made at least. A clamp holds a straight between two
// bends, and tube beyond the last one: bends without any between them may be one that is dented or
// eases, and bends at the very end what sits on it.
std::size_t LeastMadeBends(const SurfaceFit& found);

}  // namespace bendloop::pipeline
