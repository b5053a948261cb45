// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <optional>

#include "firmware-host/acceptance/plc.h"
#include "firmware-host/acceptance/register_program.h"
#include "hal/result.h"

namespace bendloop::host {

// What the robot must put back, in the state directory's file acceptance.json from before its first
// write until it has seen the program active again. A run that was cut leaves it there.
class RestoreFile {
 public:
  explicit RestoreFile(std::filesystem::path file) : file_(std::move(file)) {}

  const std::filesystem::path& path() const { return file_; }
  // kDevice when it cannot be written.
  hal::Result<void> Keep(const RegisterProgram& found, const std::string& bender) const;
  // Empty: nothing is left to put back. kBadInput for a file that is not one of these.
  hal::Result<std::optional<RegisterProgram>> Read() const;
  hal::Result<void> Remove() const;

 private:
  std::filesystem::path file_;
};

struct RestoreOptions {
  std::chrono::milliseconds reply_timeout{5000};
  std::chrono::milliseconds poll_period{2};
};

// Makes `found` the active program: with its own sequence, and if the PLC does not take that, or it
// was keyed in, with a fresh one. Staging is void then and commit 0. kDevice, with the mend, when
// it could not be seen active.
hal::Result<void> RestoreProgram(Plc& plc, const RegisterProgram& found,
                                 const RestoreOptions& options);

// `active` is `found`, but for the sequence with which it was put back.
bool IsRestored(Plc& plc, const RegisterProgram& active, const RegisterProgram& found);

}  // namespace bendloop::host
