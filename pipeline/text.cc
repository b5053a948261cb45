// SPDX-License-Identifier: Apache-2.0
#include "pipeline/text.h"

#include <cstdio>

namespace bendloop::pipeline {

std::string Fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  std::string out(text);
  if (out[0] == '-' && out.find_first_of("123456789in") == std::string::npos) out.erase(0, 1);
  return out;
}

std::string LengthName(std::size_t row, std::size_t bends) {
  if (bends == 0) return "length";
  return row >= bends ? "end length" : "length before bend " + std::to_string(row + 1);
}

std::string RotationName(std::size_t row) {
  return "bend " + std::to_string(row + 1) + " rotation";
}

std::string AngleName(std::size_t row) { return "bend " + std::to_string(row + 1) + " angle"; }

}  // namespace bendloop::pipeline
