// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_config
// Seeds: config/object-dictionaries
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "config/object_dictionary.h"
#include "tests/fuzz/reached.h"

namespace {

bendloop::Reached bound("a map bound to a dictionary");

// As register-maps/canopen.toml has them.
bendloop::hal::RegisterMap Map() {
  bendloop::hal::RegisterMap map;
  map.max_rows = 40;
  map.row_stride = 8;
  map.mode.object = {0x2000, 1};
  map.commit.emplace().object = {0x2001, 1};
  map.reply_sequence.object = {0x2001, 2};
  map.reply.object = {0x2001, 3};
  std::uint16_t index = 0x2010;
  for (auto* area : {&map.active, &map.staging}) {
    area->part_number.object = {index, 1};
    area->sequence.object = {index, 2};
    area->row_count.object = {index, 3};
    area->crc.object = {index, 4};
    area->rows_object = {static_cast<std::uint16_t>(index + 1), 0};
    index += 0x10;
  }
  return map;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto dictionary = bendloop::config::ParseObjectDictionary(text, "a.eds");
  if (!dictionary) return 0;
  if (dictionary->objects.size() > 200000) __builtin_trap();
  auto map = Map();
  if (!bendloop::config::BindObjects(map, *dictionary)) return 0;
  bound.Mark();
  // What was bound fits, one beside the other.
  if (map.active.rows_address + 320 > 65536 || map.staging.rows_address + 320 > 65536) {
    __builtin_trap();
  }
  if (map.active.crc.type != bendloop::hal::RegisterType::kUint32) __builtin_trap();
  return 0;
}
