// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace bendloop::host {

// Columns of the terminal behind `fd`; 80 when it does not say.
std::size_t TerminalColumns(int fd);
// To which sentences are broken: of the terminal behind `fd`; 0 when there is none.
std::size_t SentenceColumns(int fd);

}  // namespace bendloop::host
