// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace bendloop::cad {

// Reads a STEP or IGES file with OpenCASCADE and says what is in it as `bendloop.cad-shape/1`
// (../README.md): bodies with their faces, the faces' edges, and free curves, in mm and in place.
// Faces that are not given as cylinder, torus or plane are sampled at most `step_mm` apart; 0: 25
// by 25 times each smooth piece. Throws Standard_Failure, or std::runtime_error with a sentence
// about the file.
nlohmann::json ReadShape(const std::string& file, double step_mm = 0);

}  // namespace bendloop::cad
