// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/sentence.h"

#include <algorithm>

#include "firmware-host/console/printable.h"
#include "firmware-host/console/wrap.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kHanging = 4;  // of the further lines of a sentence

}  // namespace

std::string Sentence(const std::string& text, Style style, bool colour, std::size_t columns) {
  if (columns == 0) return "  " + Paint(Printable(text), style, colour) + "\n";
  std::string out, indent = "  ";
  for (const std::string& line :
       WrapWords(Printable(text), columns - std::min(columns, kHanging))) {
    out += indent + Paint(line, style, colour) + "\n";
    indent = std::string(kHanging, ' ');
  }
  return out;
}

std::string Below(const std::string& sentence) {
  return Sentence(sentence, Style::kPlain, false, kPlainColumns);
}

std::string Plural(std::size_t count, const char* noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

}  // namespace bendloop::host
