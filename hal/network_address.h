// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::hal {

// Is it an IPv4 or IPv6 address in digits? A name is none: looking it up has no bounded time.
bool IsNumericAddress(const std::string& host);

}  // namespace bendloop::hal
