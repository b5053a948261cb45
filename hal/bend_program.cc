// SPDX-License-Identifier: Apache-2.0
#include "hal/bend_program.h"

#include <cmath>

namespace bendloop::hal {

double WrapRotationDeg(double rotation_deg) {
  const double wrapped = std::remainder(rotation_deg, 360.0);
  return wrapped <= -180.0 ? 180.0 : wrapped;
}

}  // namespace bendloop::hal
