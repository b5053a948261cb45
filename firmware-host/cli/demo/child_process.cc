// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/demo/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <system_error>
#include <thread>
#include <utility>

namespace bendloop::host {
namespace {

using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

std::string Text(int error_number) { return std::generic_category().message(error_number); }

// Nothing but system calls: this runs between fork and exec.
[[noreturn]] void BecomeChild(const char* program, char* const* arguments, int input, int output,
                              int error, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(127);  // the parent died before prctl
  signal(SIGPIPE, SIG_DFL);
  dup2(input, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(error, STDERR_FILENO);
  execv(program, arguments);
  _exit(127);
}

}  // namespace

hal::Result<ChildProcess> ChildProcess::Start(const std::filesystem::path& program,
                                              const std::vector<std::string>& arguments,
                                              const std::filesystem::path& error_log) {
  const auto fail = [&](const std::string& what) {
    return hal::Fail(hal::ErrorKind::kDevice, program.string() + ": cannot be started: " + what);
  };
  if (access(program.c_str(), X_OK) != 0) {
    return fail(Text(errno) + "; the package bendloop-demo brings it, or the build");
  }
  int to_child[2];
  int from_child[2];
  if (pipe2(to_child, O_CLOEXEC) != 0) return fail(Text(errno));
  if (pipe2(from_child, O_CLOEXEC) != 0) {
    close(to_child[0]);
    close(to_child[1]);
    return fail(Text(errno));
  }
  const int error = open(error_log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  const std::string path = program.string();
  std::vector<char*> argv{const_cast<char*>(path.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t parent = getpid();
  const pid_t pid = error < 0 ? -1 : fork();
  if (pid == 0) BecomeChild(path.c_str(), argv.data(), to_child[0], from_child[1], error, parent);
  const int why = errno;
  close(to_child[0]);
  close(from_child[1]);
  if (error >= 0) close(error);
  if (pid < 0) {
    close(to_child[1]);
    close(from_child[0]);
    return fail(Text(why));
  }
  ChildProcess child;
  child.name_ = program.filename().string();
  child.error_log_ = error_log;
  child.pid_ = pid;
  child.input_ = to_child[1];
  child.output_ = from_child[0];
  return child;
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : name_(std::move(other.name_)),
      error_log_(std::move(other.error_log_)),
      pid_(std::exchange(other.pid_, -1)),
      input_(std::exchange(other.input_, -1)),
      output_(std::exchange(other.output_, -1)),
      pending_(std::move(other.pending_)),
      exit_code_(other.exit_code_) {}

ChildProcess::~ChildProcess() {
  Stop(2s);
  if (output_ >= 0) close(output_);
}

hal::Result<void> ChildProcess::WriteLine(const std::string& line) {
  const std::string text = line + "\n";
  std::size_t sent = 0;
  while (sent < text.size()) {
    const ssize_t n = write(input_, text.data() + sent, text.size() - sent);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      return hal::Fail(hal::ErrorKind::kDevice, name_ + ": takes no more input" + LastWords());
    }
    sent += static_cast<std::size_t>(n);
  }
  return {};
}

hal::Result<std::string> ChildProcess::Expect(const std::string& word,
                                              std::chrono::milliseconds timeout) {
  const auto deadline = Clock::now() + timeout;
  for (;;) {
    for (std::size_t end; (end = pending_.find('\n')) != std::string::npos;) {
      const std::string line = pending_.substr(0, end);
      pending_.erase(0, end + 1);
      if (line.rfind(word + " ", 0) == 0) return line.substr(word.size() + 1);
      if (line.rfind("error", 0) == 0) {
        return hal::Fail(hal::ErrorKind::kDevice, name_ + ": " + line);
      }
    }
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) {
      return hal::Fail(hal::ErrorKind::kDevice, name_ + ": did not say '" + word + "' within " +
                                                    std::to_string(timeout.count()) + " ms" +
                                                    LastWords());
    }
    pollfd wait{output_, POLLIN, 0};
    if (poll(&wait, 1, static_cast<int>(left.count())) <= 0) continue;
    char block[4096];
    const ssize_t n = read(output_, block, sizeof block);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      return hal::Fail(hal::ErrorKind::kDevice,
                       name_ + ": ended before it said '" + word + "'" + LastWords());
    }
    pending_.append(block, static_cast<std::size_t>(n));
  }
}

std::optional<int> ChildProcess::Exited() {
  if (exit_code_ || pid_ < 0) return exit_code_;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return exit_code_;
}

int ChildProcess::Stop(std::chrono::milliseconds patience) {
  if (input_ >= 0) close(std::exchange(input_, -1));
  if (pid_ < 0) return 0;
  if (!Exited()) kill(pid_, SIGTERM);
  const auto deadline = Clock::now() + patience;
  while (!Exited() && Clock::now() < deadline) std::this_thread::sleep_for(5ms);
  if (!Exited()) {
    kill(pid_, SIGKILL);
    int status = 0;
    waitpid(pid_, &status, 0);
    exit_code_ = 128 + SIGKILL;
  }
  pid_ = -1;
  return *exit_code_;
}

std::string ChildProcess::LastWords() const {
  std::ifstream log(error_log_);
  std::string last;
  for (std::string line; std::getline(log, line);) {
    if (!line.empty()) last = line;
  }
  return last.empty() ? "; see " + error_log_.string() : ": " + last;
}

}  // namespace bendloop::host
