// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/command.h"

#include <cstdio>

#include "firmware-host/daemon/state_store.h"

namespace bendloop::host {

int Report(const hal::Error& error) {
  std::fflush(stdout);
  std::fprintf(stderr, "bendloop: %s\n", error.message.c_str());
  return hal::ExitCode(error.kind);
}

int WriteOutput(const std::string& path, std::string_view text) {
  if (path == "-") {
    const bool written =
        std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0;
    if (written) return 0;
    return Report({hal::ErrorKind::kDevice, "standard output: cannot be written"});
  }
  if (auto written = WriteFileAtomically(path, text); !written) return Report(written.error());
  return 0;
}

}  // namespace bendloop::host
