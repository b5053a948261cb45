// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/result/json.h"

#include <array>
#include <cmath>
#include <string>

namespace bendloop::host {

Json Number(double value, int decimals) {
  if (!std::isfinite(value)) return nullptr;
  static constexpr std::array<double, 10> kScale = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};
  const double scale = kScale.at(static_cast<std::size_t>(decimals));
  // Beyond 2^53 the scaled value has no fraction left to round.
  if (std::abs(value) * scale < 9e15) value = std::round(value * scale) / scale;
  return value == 0 ? 0.0 : value;
}

std::string Dump(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace bendloop::host
