// SPDX-License-Identifier: Apache-2.0
#include "hal/error.h"

namespace bendloop::hal {

int ExitCode(ErrorKind kind) { return static_cast<int>(kind); }

const char* Name(ErrorKind kind) {
  switch (kind) {
    case ErrorKind::kRefused:
      return "refused";
    case ErrorKind::kUsage:
      return "usage";
    case ErrorKind::kBadInput:
      return "bad input";
    case ErrorKind::kDevice:
      return "device";
    case ErrorKind::kInternal:
      return "internal";
  }
  return "unknown";
}

}  // namespace bendloop::hal
