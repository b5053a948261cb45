// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/note_text.h"

#include <cstdio>

namespace bendloop::host {

std::string NoteText(const char* format, double value) {
  char text[240];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

}  // namespace bendloop::host
