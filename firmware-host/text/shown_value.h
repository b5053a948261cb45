// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/tube/joint_uncertainty.h"

namespace bendloop::host {

// Decimals that a person reads: the scanner's bound is some 0.02 mm and 0.005 degree.
inline constexpr int kDecimals = 3;

// How a measured value is shown, on a terminal as in the report.
struct ShownValue {
  std::string text;      // to the digits that its sigma supports, "~" before what is not known
  bool is_known = true;  // else kUnknownLegend belongs below
};
ShownValue ShowValue(pipeline::RowValueKind kind, double value, double sigma);
std::string ShowSigma(double sigma);
inline constexpr const char* kUnknownLegend =
    "~ not known: 1 sigma is more than the value, or more than 5 degrees";

}  // namespace bendloop::host
