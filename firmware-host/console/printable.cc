// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/printable.h"

#include <cstddef>

namespace bendloop::host {

std::string Printable(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    // C1 control characters (U+0080 to U+009F) are two bytes in UTF-8.
    const bool c1 = c == 0xC2 && i + 1 < text.size() && (text[i + 1] & 0xE0) == 0x80;
    if (c1) ++i;
    out += c < 0x20 || c == 0x7F || c1 ? '?' : text[i];
  }
  return out;
}

}  // namespace bendloop::host
