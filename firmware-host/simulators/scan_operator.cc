// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/simulators/scan_operator.h"

#include <unistd.h>

#include <array>
#include <cerrno>

namespace bendloop::host {
namespace {

constexpr std::size_t kMaxLineBytes = 1 << 16;

}  // namespace

CommandLines::State CommandLines::Read(const std::function<bool(const std::string&)>& obey) {
  std::array<char, 4096> block{};
  const ssize_t got = read(STDIN_FILENO, block.data(), block.size());
  if (got < 0 && (errno == EINTR || errno == EAGAIN)) return State::kMore;
  if (got > 0) input_.append(block.data(), static_cast<std::size_t>(got));
  for (std::size_t end = input_.find('\n'); end != std::string::npos; end = input_.find('\n')) {
    if (!obey(input_.substr(0, end))) return State::kQuit;
    input_.erase(0, end + 1);
  }
  return got > 0 && input_.size() <= kMaxLineBytes ? State::kMore : State::kEnded;
}

void ScanTally::Report(std::size_t finished, std::size_t abandoned, const Say& say) {
  for (; finished_ < finished; ++finished_) End("scanned ", say);
  for (; abandoned_ < abandoned; ++abandoned_) End("abandoned ", say);
}

void ScanTally::End(const char* what, const Say& say) {
  if (files_.empty()) return;
  const std::string file = files_.front();
  files_.erase(files_.begin());
  say(what, file);
}

}  // namespace bendloop::host
