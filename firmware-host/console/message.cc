// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/message.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>

#include "firmware-host/console/printable.h"
#include "firmware-host/console/terminal.h"
#include "firmware-host/console/wrap.h"

namespace bendloop::host {
namespace {

constexpr std::size_t kHanging = 4;  // of the further lines of a sentence

// One line without control characters, broken.
std::string Sentence(const std::string& line, std::size_t columns) {
  if (columns == 0) return line + "\n";
  std::string out;
  for (const std::string& each : WrapWords(line, columns - std::min(columns, kHanging))) {
    out += (out.empty() ? "" : std::string(kHanging, ' ')) + each + "\n";
  }
  return out;
}

}  // namespace

std::string MessageText(std::string_view program, std::string_view text, std::size_t columns) {
  std::string out, head = std::string(program) + ": ";
  while (!text.empty() || !head.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    out += Sentence(head + Printable(text.substr(0, end)), columns);
    head.clear();
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return out;
}

void TellPerson(std::string_view program, std::string_view text) {
  std::fputs(MessageText(program, text, SentenceColumns(STDERR_FILENO)).c_str(), stderr);
}

}  // namespace bendloop::host
