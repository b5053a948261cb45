// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "firmware-host/daemon/daemon_options.h"
#include "firmware-host/daemon/daemon_settings.h"
#include "hal/result.h"

namespace bendloop::host {

// The cell's daemon: keeps a scanner open, runs the cell loop on it, keeps results, answers for its
// state. Threads: acquisition, recorder, status, and the caller's, which runs the cell loop.
class Daemon {
 public:
  // Loads the configuration, takes the state directory, asks the journal for an attempt that a
  // crash left open. Errors are those of the start; afterwards the daemon only logs.
  static hal::Result<std::unique_ptr<Daemon>> Start(const DaemonOptions& options);
  ~Daemon();

  // Serves until RequestStop or the last of DaemonOptions::parts. Returns the exit code.
  int Run();
  // Async-signal-safe.
  static void RequestStop();
  // Async-signal-safe. The cell file and all that it names are read again between two parts, while
  // no correction waits: the cell then begins anew with them. Where they are not right it goes on
  // as it is, with an alarm.
  static void NoteHangUp();

 private:
  class Impl;
  static hal::Result<std::unique_ptr<Impl>> Begin(const DaemonOptions& options,
                                                  DaemonSettings settings);
  // Where memory is short, that is the error.
  hal::Result<std::unique_ptr<Impl>> BeginAnew(const DaemonSettings& settings) const;
  Daemon(const DaemonOptions& options, std::unique_ptr<Impl> impl);

  const DaemonOptions options_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bendloop::host
