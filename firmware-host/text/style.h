// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace bendloop::host {

// What a text means; the colour follows from it and never stands alone for it.
enum class Style { kPlain, kStrong, kFaint, kGood, kBad, kWarning };

// Whether colour may be written to this file descriptor: it is a terminal that knows colour, and
// NO_COLOR is unset or empty (no-color.org).
bool ColourAllowed(int fd);

// `text` in the colour of `style`, or `text` itself when `colour` is false.
std::string Paint(std::string_view text, Style style, bool colour);

// Columns that `text` takes on a terminal: its UTF-8 code points. Colour codes must not be in it.
std::size_t Width(std::string_view text);

}  // namespace bendloop::host
