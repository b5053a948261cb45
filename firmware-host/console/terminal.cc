// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/console/terminal.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include "firmware-host/console/wrap.h"

namespace bendloop::host {

std::size_t SentenceColumns(int fd) { return isatty(fd) == 1 ? TerminalColumns(fd) : 0; }

std::size_t TerminalColumns(int fd) {
  winsize size{};
  return ioctl(fd, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : kPlainColumns;
}

}  // namespace bendloop::host
