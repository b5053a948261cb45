// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_host_result
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "firmware-host/result/result_json.h"
#include "tests/fuzz/reached.h"

namespace {
bendloop::Reached with_correction("a result with a correction");
bendloop::Reached accepted("a result that is accepted");
}  // namespace

// Whatever is read can be written again, and reads back to the same bytes.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace bendloop::host;
  const auto read = ReadResultJson({reinterpret_cast<const char*>(data), size}, "fuzz.json");
  if (!read) return 0;
  accepted.Mark();
  if (read->correction) with_correction.Mark();
  const ResultJsonOptions options{.spine = true, .timing = false};
  const std::string text = WriteResultJson(*read, options);
  const auto again = ReadResultJson(text, "again.json");
  if (!again) std::abort();
  if (WriteResultJson(*again, options) != text) std::abort();
  return 0;
}
