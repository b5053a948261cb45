// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace bendloop::pipeline {

// "bend 3 angle", "bend 3 rotation", "length before bend 3", "end length"; rows from 0.
std::string LengthName(std::size_t row, std::size_t bends);
std::string RotationName(std::size_t row);
std::string AngleName(std::size_t row);

}  // namespace bendloop::pipeline
