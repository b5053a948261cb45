// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace bendloop::hal {

// Who has to act. The numbers are the exit codes of every bendloop command.
enum class ErrorKind {
  kRefused = 1,   // measured, but refused or out of tolerance: the setter
  kUsage = 2,     // wrong command line: the caller
  kBadInput = 3,  // a file or message that is not what it should be: its author
  kDevice = 4,    // scanner, bender or link failed: the integrator
  kInternal = 5,  // our own fault: us
};

// `message` is one line for a person: where (file, line, key or byte), what was found, what was
// expected, and the mend.
struct Error {
  ErrorKind kind = ErrorKind::kInternal;
  std::string message;
};

int ExitCode(ErrorKind kind);
const char* Name(ErrorKind kind);

}  // namespace bendloop::hal
