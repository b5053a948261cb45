// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/shown_value.h"

#include <cmath>

#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

using pipeline::RowValueKind;

// 1 sigma from which on a number does not tell where it is: what no bender could use.
constexpr double kUnknownDeg = 5;
constexpr double kUnknownMm = 0.3;  // a straight of nothing is well known to be short

bool IsUnknown(RowValueKind kind, double value, double sigma) {
  const bool beyond = sigma > std::abs(value);
  switch (kind) {
    case RowValueKind::kLength:
      return beyond && sigma > kUnknownMm;
    case RowValueKind::kRotation:
      return sigma > kUnknownDeg;
    case RowValueKind::kAngle:
      return beyond || sigma > kUnknownDeg;
    case RowValueKind::kBendRadius:
      return beyond;
  }
  return false;
}

}  // namespace

ShownValue ShowValue(RowValueKind kind, double value, double sigma) {
  const bool is_known = !IsUnknown(kind, value, sigma);
  return {(is_known ? "" : "~") + Fixed(value, SigmaDecimals(sigma, kDecimals)), is_known};
}

std::string ShowSigma(double sigma) { return Fixed(sigma, SigmaDecimals(sigma, kDecimals)); }

}  // namespace bendloop::host
