// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "firmware-host/result/json.h"
#include "firmware-host/result/run_result.h"
#include "hal/result.h"

namespace bendloop::host {

// Of the file that a scan without a measurement leaves in the place of its result.
inline constexpr const char* kFailedScanSchema = "bendloop.failed-scan/1";

struct ResultJsonOptions {
  bool spine = false;  // the measured spine; always set it for canal and free-form models
  bool timing = true;  // the only part that differs between two runs on the same input
};

// The schema "bendloop.result/1", described in firmware-host/result/README.md. Lengths and angles
// are rounded to 1e-6 mm and 1e-6 degree; the same result gives the same bytes; "timing_ms" is the
// last key.
Json ResultJson(const RunResult& result, const ResultJsonOptions& options = {});

// The same as indented text that ends with a newline: what `--json` writes.
std::string WriteResultJson(const RunResult& result, const ResultJsonOptions& options = {});

// Reads what WriteResultJson wrote; unknown keys are left out. Scanned surface samples are not part
// of the schema and come back empty. `name` is the file's name for errors. kBadInput: not JSON
// (byte), another schema, or a key that is missing or of another type (JSON pointer to it).
// A failed scan's file in the place of a result is an error with the scan's reason.
hal::Result<RunResult> ReadResultJson(std::string_view text, std::string_view name);

}  // namespace bendloop::host
