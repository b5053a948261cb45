// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_drivers_modbus_bender bendloop_drivers_simulated_bender bendloop_host_commit
//
// Whatever a PLC has in its registers, and whatever a client writes into the staging area before a
// commit. First byte: which map and what to do; then registers, high byte first.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>
#include <vector>

#include "drivers/register_bender/field_codec.h"
#include "drivers/register_bender/program_codec.h"
#include "drivers/simulated_bender/bender_memory.h"
#include "firmware-host/commit/journal_json.h"
#include "tests/fuzz/reached.h"
#include "tests/support/bender_maps.h"

namespace {

using namespace bendloop;

Reached journal("a program of the journal");
Reached staged_program("a staged program that is taken");
Reached accepted("a commit that is accepted");

void Check(bool holds) {
  if (!holds) std::abort();
}

void Fill(drivers::RegisterImage& image, const drivers::RegisterRange& range,
          const std::uint8_t*& data, std::size_t& size) {
  std::uint16_t* to = image.At(range.space, static_cast<std::uint16_t>(range.address));
  for (std::uint32_t i = 0; i < range.count; ++i) {
    to[i] = size >= 2 ? static_cast<std::uint16_t>(data[0] << 8 | data[1]) : std::uint16_t{0};
    if (size >= 2) data += 2, size -= 2;
  }
}

void CheckProgram(const hal::RegisterMap& map, const hal::ProgramBlock& block) {
  Check(block.program.rows.size() <= map.max_rows);
  for (const hal::BendRow& row : block.program.rows) {
    Check(std::isfinite(row.length_mm) && std::isfinite(row.angle_deg));
    Check(row.rotation_deg > -180 && row.rotation_deg <= 180);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  const std::uint8_t choice = *data++;
  --size;
  if (choice & 0x80) {
    const auto block = host::ProgramFromJson({reinterpret_cast<const char*>(data), size});
    if (!block) return 0;
    journal.Mark();
    (void)host::ProgramToJson(*block);
    return 0;
  }
  static const hal::RegisterMap kMaps[] = {test::PlainMap(), test::OddMap()};
  const hal::RegisterMap& map = kMaps[choice & 1];
  static drivers::BenderMemory memories[] = {drivers::BenderMemory(kMaps[0]),
                                             drivers::BenderMemory(kMaps[1])};
  drivers::BenderMemory& memory = memories[choice & 1];
  (void)memory.LoadActive({1, 1, {{{10, 0, 45, {}}, {10, 0, 0, {}}}}, 0});
  const hal::ProgramBlock before = memory.Active().value();

  std::vector<drivers::RegisterRange> heads = drivers::HeadRanges(map.staging);
  heads.push_back(drivers::RangeOf(*map.commit));
  for (const auto& range : heads) Fill(memory.image(), range, data, size);
  Fill(memory.image(), drivers::RowsRange(map, map.staging, map.max_rows), data, size);
  const auto staged = memory.Staged();
  if (staged) {
    staged_program.Mark();
    CheckProgram(map, *staged);
  }
  memory.HandleCommit(0);
  const auto after = memory.Active();
  Check(after.has_value());
  CheckProgram(map, *after);
  if (*after != before) accepted.Mark();
  Check(*after == before || (staged && *after == *staged));
  return 0;
}
