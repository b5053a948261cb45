// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace bendloop::pipeline {

// How samples reach the spine.
enum class SpineMethod : std::uint8_t {
  kMls,        // onto the axes of local cylinders (Bauer & Polthier 2009, section 3)
  kShrinking,  // along their normals until the set is thin (Lee & Kim 2004)
};

}  // namespace bendloop::pipeline
