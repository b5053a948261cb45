// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace bendloop::host {

// `text` with control characters replaced, so that a name from a file or a device cannot move the
// cursor or set colours.
std::string Printable(std::string_view text);

}  // namespace bendloop::host
