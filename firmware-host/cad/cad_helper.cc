// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/cad_helper.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

namespace bendloop::host {
namespace {

using Clock = std::chrono::steady_clock;

// More than any tube's faces take; an answer without an end is cut here.
constexpr std::size_t kMostAnswerBytes = std::size_t{1} << 30;

std::string ErrnoText() { return std::generic_category().message(errno); }

hal::Result<std::string> FindHelper() {
  std::error_code error;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  for (const auto& path : {own / "bendloop-cad", own.parent_path() / "bin" / "bendloop-cad",
                           own.parent_path() / "libexec" / "bendloop" / "bendloop-cad"}) {
    if (access(path.c_str(), X_OK) == 0) return path.string();
  }
  return hal::Fail(hal::ErrorKind::kDevice,
                   "bendloop-cad is not installed, which reads and writes CAD files: install the "
                   "package bendloop-cad; from sources it is built where OpenCASCADE is, of the "
                   "package libocct-data-exchange-dev");
}

struct Pipe {
  int read = -1, write = -1;
  Pipe() {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) == 0) std::tie(read, write) = std::pair(ends[0], ends[1]);
  }
  ~Pipe() {
    CloseRead();
    CloseWrite();
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  void CloseRead() {
    if (read >= 0) close(std::exchange(read, -1));
  }
  void CloseWrite() {
    if (write >= 0) close(std::exchange(write, -1));
  }
};

// Nothing but system calls: this runs between fork and exec.
[[noreturn]] void BecomeChild(const char* program, char* const* arguments, int input, int output,
                              pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(127);
  signal(SIGPIPE, SIG_DFL);
  const int nothing = open("/dev/null", O_WRONLY);
  dup2(input, STDIN_FILENO);
  dup2(output, STDOUT_FILENO);
  dup2(nothing, STDERR_FILENO);
  execv(program, arguments);
  _exit(127);
}

// Feeds and reads until the child closes its output. False: the time is over, or the answer too
// long.
bool Exchange(Pipe& to, Pipe& from, const std::string& input, Clock::time_point deadline,
              std::string& answer) {
  std::size_t sent = 0;
  fcntl(to.write, F_SETFL, O_NONBLOCK);
  while (answer.size() < kMostAnswerBytes) {
    if (sent == input.size()) to.CloseWrite();
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) return false;
    pollfd wait[2] = {{from.read, POLLIN, 0}, {to.write, POLLOUT, 0}};  // -1 is passed over
    if (poll(wait, 2, int(left.count())) <= 0) continue;
    if (wait[1].revents != 0) {
      const ssize_t n = write(to.write, input.data() + sent, input.size() - sent);
      if (n > 0) sent += std::size_t(n);
      if (n < 0 && errno != EAGAIN && errno != EINTR) sent = input.size();  // it takes no more
    }
    if (wait[0].revents == 0) continue;
    static constexpr std::size_t kBlock = 1 << 16;
    const std::size_t before = answer.size();
    answer.resize(before + kBlock);
    const ssize_t n = read(from.read, answer.data() + before, kBlock);
    answer.resize(before + (n > 0 ? std::size_t(n) : 0));
    if (n == 0 || (n < 0 && errno != EINTR)) return true;
  }
  return false;
}

}  // namespace

hal::Result<std::string> RunCadHelper(const std::vector<std::string>& arguments,
                                      const std::string& input, const std::string& file,
                                      std::chrono::seconds patience) {
  const auto helper = FindHelper();
  if (!helper) return helper;
  std::vector<char*> argv{const_cast<char*>(helper->c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  Pipe to, from;
  if (to.write < 0 || from.read < 0) {
    return hal::Fail(hal::ErrorKind::kDevice, "bendloop-cad: no pipe to it: " + ErrnoText());
  }
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) BecomeChild(helper->c_str(), argv.data(), to.read, from.write, parent);
  if (child < 0) {
    return hal::Fail(hal::ErrorKind::kDevice, "bendloop-cad: cannot be started: " + ErrnoText());
  }
  to.CloseRead();
  from.CloseWrite();
  std::string answer;
  const bool ended = Exchange(to, from, input, Clock::now() + patience, answer);
  if (!ended) kill(child, SIGKILL);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (!ended) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     file + ": OpenCASCADE was not done with it in " +
                         std::to_string(patience.count()) +
                         " s; expected a tube or a small assembly: export the tube alone");
  }
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || answer.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     file +
                         ": OpenCASCADE died of it; the file is damaged, or needs more than 4 GB: "
                         "export the tube alone, as STEP AP214");
  }
  return answer;
}

}  // namespace bendloop::host
