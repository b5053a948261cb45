// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "hal/tube.h"

namespace bendloop::pipeline {

inline const hal::BendProgram kPart{
    {{80, 0, 90, 40.0}, {120, 45, 60, 40.0}, {60, -100, 30, 40.0}, {150, 0, 0, std::nullopt}}};
// A U: the same from both ends.
inline const hal::BendProgram kU{
    {{100, 0, 90, 40.0}, {50, 0, 90, 40.0}, {100, 0, 0, std::nullopt}}};

}  // namespace bendloop::pipeline
