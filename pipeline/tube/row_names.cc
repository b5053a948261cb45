// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/row_names.h"

namespace bendloop::pipeline {

std::string LengthName(std::size_t row, std::size_t bends) {
  if (bends == 0) return "length";
  return row >= bends ? "end length" : "length before bend " + std::to_string(row + 1);
}

std::string RotationName(std::size_t row) {
  return "bend " + std::to_string(row + 1) + " rotation";
}

std::string AngleName(std::size_t row) { return "bend " + std::to_string(row + 1) + " angle"; }

}  // namespace bendloop::pipeline
