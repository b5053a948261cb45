// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "hal/bend_program.h"
#include "hal/result.h"

namespace bendloop::host {

// A program block as the journal keeps it: one line of JSON from which every number comes back
// bit for bit.
std::string ProgramToJson(const hal::ProgramBlock& block);
// kBadInput if the text is something else.
hal::Result<hal::ProgramBlock> ProgramFromJson(std::string_view text);

}  // namespace bendloop::host
