// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace bendloop::host {

// "PROGRAM: TEXT" for a person, each line of it broken to `columns`; 0: not at all. Names of files
// and devices stand in it: control characters are replaced.
std::string MessageText(std::string_view program, std::string_view text, std::size_t columns);

// The same on standard error, broken where that is a terminal: a program that reads it wants each
// sentence on one line.
void TellPerson(std::string_view program, std::string_view text);

}  // namespace bendloop::host
