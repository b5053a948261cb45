// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_config
// Seeds: config/cells
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "config/digest.h"
#include "config/load.h"
#include "tests/fuzz/reached.h"

namespace {
bendloop::Reached accepted("a cell that is accepted");
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto cell = bendloop::config::ParseCell(text, "cell.toml", "/etc/bendloop");
  if (cell) accepted.Mark();
  if (cell && bendloop::config::Digest(*cell).size() != 16) __builtin_trap();
  if (!cell && cell.error().message.empty()) __builtin_trap();
  return 0;
}
