// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "pipeline/fit/bends_with_bows.h"
#include "pipeline/fit/bow_shapes.h"
#include "pipeline/tube/representations.h"

namespace bendloop::pipeline {

// A tube of fewer bends, or of more.
struct BendChange {
  ControlPolygon corners;
  bool is_certain = false;  // whatever the points say
  double unmade = 0;        // bends that it takes away and no machine makes
};

// What might be there instead, of fewer bends or of more; towards the nominal, where there is one.
std::vector<BendChange> BendChanges(const BowedSolution& now,
                                    std::optional<std::size_t> nominal_bends);

// A slight bend in a straight looks like that.
bool IsMoreThanBendersLeave(const Bow& bow, double straight_mm);

}  // namespace bendloop::pipeline
