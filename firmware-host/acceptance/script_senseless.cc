// SPDX-License-Identifier: Apache-2.0
//
// A PLC whose registers make no sense by the map: what would make them?
#include <utility>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "firmware-host/acceptance/scripts.h"
#include "firmware-host/acceptance/state_words.h"

namespace bendloop::host {
namespace {

// Is the active program right if the registers are read by `map`?
bool MakesSense(Plc& plc, const hal::RegisterMap& map) {
  drivers::RegisterImage image;
  if (!plc.frames().Read(drivers::HeadRanges(map.active), image)) return false;
  ProgramForm form(map);
  const auto head = form.Take(map.active, 0, image);
  if (!head || head->row_count == 0 || head->row_count > map.max_rows) return false;
  if (!plc.frames().Read({drivers::RowsRange(map, map.active, head->row_count)}, image)) {
    return false;
  }
  const auto program = form.Take(map.active, head->row_count, image);
  return program && form.Crc(*program) == program->crc;
}

}  // namespace

bool PlaySenseless(Bench& bench) {
  Plc& plc = bench.plc();
  if (MakesSense(plc, plc.map())) {
    bench.Run("mode is a code of the map", [&] {
      if (const auto state = plc.State()) ExpectKnownMode(bench, *state);
    });
    return bench.is_broken(Rule::kMode);
  }
  bench.Run("words and bytes are in the order of the map", [&] {
    for (const auto& [words, bytes] :
         {std::pair(true, false), std::pair(false, true), std::pair(true, true)}) {
      hal::RegisterMap map = plc.map();
      if (words) map.high_word_first = !map.high_word_first;
      if (bytes) map.high_byte_first = !map.high_byte_first;
      if (!MakesSense(plc, map)) continue;
      const std::string what = words && bytes ? "words and bytes" : words ? "words" : "bytes";
      bench.Expect(Rule::kStores, false,
                   what +
                       " are the other way round than the register map says: mend the PLC, or "
                       "[words] in the map");
      return;
    }
  });
  return bench.is_broken(Rule::kStores);
}

}  // namespace bendloop::host
