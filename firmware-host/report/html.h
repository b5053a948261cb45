// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "pipeline/inspection/inspection.h"

namespace bendloop::host {

// Text as it may stand between tags or inside a quoted attribute; control characters are left out.
std::string Escape(std::string_view text);

// JSON text as it may stand inside <script>: no "<" is left in it.
std::string ScriptSafe(std::string json);

// Little-endian float32 values as base64.
std::string Base64(std::span<const float> values);

// A state as a person reads it: mark, word and CSS class; the mark and the word never leave it to
// the colour alone.
struct StateMark {
  const char* css;
  const char* mark;
  const char* word;
};
StateMark MarkOf(pipeline::ToleranceState state);
StateMark MarkOf(pipeline::Verdict verdict);

// Decimals with which `value` and its half are written exactly: the labels of an axis. At most 4.
int TickDecimals(double value);

}  // namespace bendloop::host
