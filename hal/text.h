// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

// What every reader of a text file needs.
namespace bendloop::hal {

// Without blanks, tabs and carriage returns at both ends.
std::string_view Trimmed(std::string_view text);
// A to Z as a to z, whatever the locale.
std::string Lower(std::string_view text);

}  // namespace bendloop::hal
