// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "firmware-host/result/run_result.h"

namespace bendloop::host {

struct ReportOptions {
  std::string title;                        // empty: the part's name
  std::size_t most_samples_a_part = 20000;  // scanned points kept for the picture
  std::size_t most_samples = 60000;         // of all parts together: a page of a few MB
};

// One self-contained HTML page for `runs`, oldest first; the last one is shown when it opens. It
// loads nothing, so it opens without a network. The same runs give the same bytes.
std::string ReportHtml(std::span<const RunResult> runs, const ReportOptions& options = {});

}  // namespace bendloop::host
