// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace bendloop::host {

// Keys stay in the order in which they are written, so that the same result is the same bytes.
using Json = nlohmann::ordered_json;

// `value` rounded to `decimals` places, never -0; null when it is not finite. The text is the
// shortest that reads back to the same rounded value.
Json Number(double value, int decimals = 6);

// One line or indented text. Bytes that are not UTF-8 become U+FFFD instead of an exception.
std::string Dump(const Json& json, int indent = -1);

}  // namespace bendloop::host
