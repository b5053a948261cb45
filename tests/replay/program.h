// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace bendloop::testing {

// What a program of ours said and how it ended.
struct Ran {
  int code = -1;
  std::string out;
  std::string err;
};

inline std::string Slurp(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// How much longer a processor that is emulated takes for the same, and more where it has company.
#ifdef BENDLOOP_EMULATED
inline constexpr int kSlowness = 8;
#else
inline constexpr int kSlowness = 1;
#endif

// A folder that goes with the test.
class Scratch {
 public:
  Scratch() {
    std::string name = (std::filesystem::temp_directory_path() / "bendloop-XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~Scratch() { std::filesystem::remove_all(path_); }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

  // `bendloop ARGUMENTS` as a shell would start it, ended after `seconds`.
  Ran Bendloop(const std::string& arguments, int seconds = 120) const {
    const auto out = path_ / ".out";
    const auto err = path_ / ".err";
    const std::string line = "timeout -k 5 " + std::to_string(kSlowness * seconds) +
                             " " BENDLOOP_BIN_DIR "/bendloop " + arguments + " >" + out.string() +
                             " 2>" + err.string() + " </dev/null";
    const int status = std::system(line.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, Slurp(out), Slurp(err)};
  }

 private:
  std::filesystem::path path_;
};

}  // namespace bendloop::testing
