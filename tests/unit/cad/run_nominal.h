// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "config/load.h"
#include "hal/result.h"
#include "hal/tube.h"

// `bendloop nominal` as a test runs it.
namespace bendloop::test {

struct Outcome {
  int code = -1;
  std::string out, err;
  nlohmann::json json;
  hal::Result<config::PartConfig> part;
};

// `bendloop nominal FILE WORDS`, with its part file and JSON.
Outcome Nominal(const std::string& file, std::vector<std::string> words = {});

// Four bends, two of them without a straight between.
hal::Tube DemoTube();

void ExpectRows(const Outcome& outcome, const hal::BendProgram& expected, double tolerance = 1e-6);

}  // namespace bendloop::test
