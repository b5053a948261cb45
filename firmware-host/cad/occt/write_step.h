// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace bendloop::cad {

// Writes a tube, `bendloop.cad-tube/1` (../README.md), as STEP AP214 in mm: its centre line of
// lines and arcs, and its outer surface (the whole solid where the wall is known). Or curves,
// `bendloop.cad-curves/1`: rational B-splines by poles, weights, knots and multiplicities. Throws
// Standard_Failure, nlohmann's errors, or std::runtime_error.
void WriteStep(const nlohmann::json& tube, const std::string& file);

}  // namespace bendloop::cad
