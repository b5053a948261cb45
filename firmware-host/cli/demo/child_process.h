// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "hal/result.h"

namespace bendloop::host {

// A process of our own with its standard input and output as lines and its standard error in a
// file. It ends with us, whatever ends us (PR_SET_PDEATHSIG), and with this object.
class ChildProcess {
 public:
  static hal::Result<ChildProcess> Start(const std::filesystem::path& program,
                                         const std::vector<std::string>& arguments,
                                         const std::filesystem::path& error_log);
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;
  ~ChildProcess();

  const std::string& name() const { return name_; }
  hal::Result<void> WriteLine(const std::string& line);
  // The next line that starts with `word`, without the word and the blank after it. kDevice when
  // the process says "error ...", ends, or the time is over.
  hal::Result<std::string> Expect(const std::string& word, std::chrono::milliseconds timeout);
  // The exit code once it has ended (128 + signal when killed).
  std::optional<int> Exited();
  // Closes its input, asks it to end (SIGTERM), kills it after `patience`.
  int Stop(std::chrono::milliseconds patience);
  // The error log's last line, to be put behind a message.
  std::string LastWords() const;

 private:
  ChildProcess() = default;

  std::string name_;
  std::filesystem::path error_log_;
  pid_t pid_ = -1;
  int input_ = -1;
  int output_ = -1;
  std::string pending_;
  std::optional<int> exit_code_;
};

}  // namespace bendloop::host
