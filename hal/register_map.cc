// SPDX-License-Identifier: Apache-2.0
#include "hal/register_map.h"

#include <cstdio>

namespace bendloop::hal {

std::string Name(ObjectAddress object) {
  char text[16];
  std::snprintf(text, sizeof text, "%04Xsub%X", object.index, object.sub);
  return text;
}

}  // namespace bendloop::hal
