// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace bendloop::host {

// The files that the report's page is made of, as they were at build time.
std::string_view ThreeJs();   // three.js (MIT)
std::string_view OrbitJs();   // its orbit controls (MIT)
std::string_view ReportJs();  // ours
std::string_view ReportCss();

}  // namespace bendloop::host
