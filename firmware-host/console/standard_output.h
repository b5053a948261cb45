// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace bendloop::host {

// The last thing that a program's main() does: writes what still waits for standard output, and
// returns the exit code. `code` where all arrived; where it did not (a full disk, a closed pipe),
// "PROGRAM: standard output: ..." on standard error and 4, as half an output must not pass for a
// whole one.
int FinishOutput(const char* program, int code);

}  // namespace bendloop::host
