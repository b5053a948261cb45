// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "firmware-host/alarms/alarm_board.h"
#include "firmware-host/cell/bender_desk.h"
#include "firmware-host/daemon/part_keeper.h"
#include "hal/result.h"

namespace bendloop::host {

// What the last run left behind, put in order before anything is decided.

// A journal that cannot be read is moved aside and must not keep the cell from measuring; what
// locks corrections stands in the new one.
hal::Result<void> MendJournal(const std::filesystem::path& journal);

// A commit whose end was not seen, a correction that waited: results, history and alarms say what
// became of them. One that was sent and is in no history yet is added to it.
void SettleWhatIsOpen(BenderDesk& desk, PartKeeper& keeper, AlarmBoard& alarms);

}  // namespace bendloop::host
