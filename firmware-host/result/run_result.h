// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "pipeline/measurement.h"

namespace bendloop::host {

// Everything that one scan of one part led to.
struct RunResult {
  std::string part;      // name of the part; empty for a cloud without one
  std::string session;   // id of the session or path of the cloud
  std::string time;      // ISO 8601, when the scan started, from the session; never "now"
  std::string software;  // name and version
  pipeline::Measurement measurement;
};

}  // namespace bendloop::host
