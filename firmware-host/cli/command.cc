// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/command.h"

#include <cstdio>

#include "firmware-host/console/message.h"
#include "firmware-host/console/output_file.h"
#include "firmware-host/console/standard_output.h"

namespace bendloop::host {

int Report(const hal::Error& error) {
  std::fflush(stdout);
  TellPerson("bendloop", error.message);
  return hal::ExitCode(error.kind);
}

void Note(const std::string& text) { TellPerson("bendloop", "note: " + text); }

int WriteOutput(const std::string& path, std::string_view text) {
  if (path == "-") {
    std::fwrite(text.data(), 1, text.size(), stdout);  // main() asks whether it arrived
    return 0;
  }
  if (auto written = WriteOutputFile(path, text); !written) return Report(written.error());
  return 0;
}

}  // namespace bendloop::host
