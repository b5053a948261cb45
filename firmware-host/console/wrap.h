// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace bendloop::host {

// The columns of a terminal that says nothing about itself, and of every --help.
inline constexpr std::size_t kPlainColumns = 80;

// `text` in lines of at most `columns` characters, broken at blanks, but not between a number and
// its unit; a longer word has its own line. Never empty.
std::vector<std::string> WrapWords(std::string_view text, std::size_t columns);

// `text` whose lines are set already, as lists of commands are: those that `columns` do not hold
// are broken, and go on under their last column of words.
std::string WrapLines(std::string_view text, std::size_t columns);

// The same, and what is left of a sentence that was broken begins the next line of it.
std::string WrapProse(std::string_view text, std::size_t columns);

}  // namespace bendloop::host
