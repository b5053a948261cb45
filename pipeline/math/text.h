// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

// Numbers in the sentences that setters read.
namespace bendloop::pipeline {

// printf's "%.*f" with the trailing minus of a rounded zero removed.
std::string Fixed(double value, int decimals);

}  // namespace bendloop::pipeline
