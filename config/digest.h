// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "config/cell_config.h"
#include "hal/register_map.h"

namespace bendloop::config {

// What the cell is set to, whatever file or order it was written in: every key with its effective
// value, defaults, part and register map included, one `key = value` a line. Places of files
// (file, state_dir, record.directory) and how a device is reached or scheduled (scanner, realtime,
// log) are left out: they do not change what is measured or sent.
std::string EffectiveText(const CellConfig& cell);

// FNV-1a, 64 bits, of EffectiveText: 16 hexadecimal digits, the session's `config_digest`.
std::string Digest(const CellConfig& cell);

// The same of a register map alone.
std::string Digest(const hal::RegisterMap& map);

}  // namespace bendloop::config
