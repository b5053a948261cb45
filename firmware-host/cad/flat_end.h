// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "firmware-host/cad/form_face.h"

namespace bendloop::host {

// An end that is pressed flat.
struct FlatEnd {
  double wide_mm = 0, thick_mm = 0;
  Eigen::Vector3d way;  // unit, along which it is wide
};

// What the edges at `at_mm` of an end's axis span, where that is wider one way than the tube and
// thinner the other; nothing where it is not.
std::optional<FlatEnd> FlatEndOf(const CadBody& body, const EndView& view, double at_mm,
                                 double pipe_radius_mm);

}  // namespace bendloop::host
