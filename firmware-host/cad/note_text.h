// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::host {

// A note, or a part of one: `format` as of printf, with one double in it.
std::string NoteText(const char* format, double value);

}  // namespace bendloop::host
