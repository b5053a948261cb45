// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace bendloop::host {

// The one of `words` that was most likely meant: a third of its letters differ at most (swapped
// neighbours count once), or it begins with what was typed. Empty when none is near.
std::string Nearest(std::string_view typed, const std::vector<std::string>& words);

}  // namespace bendloop::host
