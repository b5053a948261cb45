// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_config
// Seeds: config/register-maps
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "config/load.h"
#include "tests/fuzz/reached.h"

namespace {
bendloop::Reached accepted("a register map that is accepted");
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto map = bendloop::config::ParseRegisterMap(text, "map.toml");
  if (!map) return 0;
  accepted.Mark();
  // What was accepted fits the address space, whatever sizes the file claims.
  const std::uint32_t rows = std::uint32_t{map->max_rows} * map->row_stride;
  if (map->active.rows_address + rows > 65536) __builtin_trap();
  if (map->staging.rows_address + rows > 65536) __builtin_trap();
  if (map->row_length_mm.address + 1 > map->row_stride) __builtin_trap();
  return 0;
}
