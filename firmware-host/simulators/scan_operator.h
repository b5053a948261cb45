// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

// What stands beside both simulated scanners.
namespace bendloop::host {

// The operator's words on standard input, one command a line.
class CommandLines {
 public:
  enum class State { kMore, kEnded, kQuit };

  // Reads what is waiting and hands each whole line to `obey`, which says false to quit. kEnded:
  // nobody types any more, or a line without end.
  State Read(const std::function<bool(const std::string&)>& obey);

 private:
  std::string input_;
};

// Which of the scans that were begun are over, in their order.
class ScanTally {
 public:
  // "scanned " or "abandoned ", and the file that it was begun with.
  using Say = std::function<void(const char* what, const std::string& file)>;

  void Begin(const std::string& file) { files_.push_back(file); }
  // Says what has ended since the last call; how many ended so far is the scanner's to count.
  void Report(std::size_t finished, std::size_t abandoned, const Say& say);

 private:
  void End(const char* what, const Say& say);

  std::vector<std::string> files_;
  std::size_t finished_ = 0;
  std::size_t abandoned_ = 0;
};

}  // namespace bendloop::host
