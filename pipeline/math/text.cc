// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/text.h"

#include <cstdio>

namespace bendloop::pipeline {

std::string Fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  std::string out(text);
  if (out[0] == '-' && out.find_first_of("123456789in") == std::string::npos) out.erase(0, 1);
  return out;
}

}  // namespace bendloop::pipeline
