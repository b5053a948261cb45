// SPDX-License-Identifier: Apache-2.0
// Links: bendloop_host_cloud
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "firmware-host/cloud/formats.h"
#include "tests/fuzz/cloud_fuzz_check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  bendloop::CheckCloud(bendloop::host::ParsePly(bytes, "fuzz", 1.0), size);
  return 0;
}
