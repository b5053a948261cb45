// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "firmware-host/commit/commit_protocol.h"
#include "firmware-host/result/run_result.h"

namespace bendloop::host {

// Where a part may have left something.
struct PartFiles {
  std::filesystem::path result;
  std::filesystem::path session;
};

// A part whose process ended after its correction was sent and before the history had it: its
// result, if that was kept; else what its recording says of itself, and `report`, with a warning
// that nothing is known of what was measured. The scan is not measured again here: one that ended a
// process would end each start.
RunResult LostPart(const PartFiles& files, const std::string& session, const CommitReport& report);

}  // namespace bendloop::host
