// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "pipeline/tube/measurement.h"

namespace bendloop::host {

// "40 % of the points do not lie on the tube: most of them 3.1 to 60.2 mm off its surface, beside
// 12 to 200 mm of it". "": a tenth of them at most, or no place is known.
std::string OutlierPlace(std::span<const Eigen::Vector3d> points_mm,
                         const pipeline::Measurement& measurement);

}  // namespace bendloop::host
