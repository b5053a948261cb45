// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/standard_output.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iostream>
#include <string>
#include <system_error>

#include "hal/error.h"

namespace bendloop::host {

int FinishOutput(const char* program, int code) {
  errno = 0;
  std::cout.flush();
  const bool flushed = std::fflush(stdout) == 0;
  const std::string why = errno != 0 ? ": " + std::generic_category().message(errno) : "";
  if (std::cout.good() && flushed && std::ferror(stdout) == 0) return code;
  std::fprintf(stderr,
               "%s: standard output: cannot be written%s; is the disk full or the pipe closed?\n",
               program, why.c_str());
  return std::max(code, hal::ExitCode(hal::ErrorKind::kDevice));
}

}  // namespace bendloop::host
