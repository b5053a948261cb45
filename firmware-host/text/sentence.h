// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "firmware-host/text/style.h"

namespace bendloop::host {

// A sentence in lines that `columns` hold; 0: in one.
std::string Sentence(const std::string& text, Style style, bool colour, std::size_t columns);
// Below a table, which has 80 columns in any case.
std::string Below(const std::string& sentence);
// "1 bend", "2 bends"
std::string Plural(std::size_t count, const char* noun);

}  // namespace bendloop::host
