// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_host_convert
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "firmware-host/convert/tube_table.h"
#include "tests/fuzz/reached.h"

namespace {
bendloop::Reached kinds[] = {bendloop::Reached("xyz"), bendloop::Reached("lra"),
                             bendloop::Reached("ybc"), bendloop::Reached("pose")};
}

// Whatever is read as a tube can be written as LRA; errors are one line.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace bendloop::host;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto table = ReadTubeTable(text, "fuzz", {});
  if (!table) {
    if (table.error().message.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  kinds[static_cast<std::size_t>(table->kind)].Mark();
  for (const auto format : {TableFormat::kText, TableFormat::kCsv, TableFormat::kJson}) {
    if (!WriteTubeTable(table->tube, {TableKind::kLra, format, {}, {}})) std::abort();
  }
  (void)WriteTubeTable(table->tube, {TableKind::kXyz, TableFormat::kText, {}, {}});
  return 0;
}
