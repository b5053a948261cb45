// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/last_run.h"

#include <spdlog/spdlog.h>

#include <optional>
#include <string>

#include "firmware-host/ledger/damaged_journal.h"

namespace bendloop::host {

hal::Result<void> MendJournal(const std::filesystem::path& journal) {
  const auto aside = SetDamagedJournalAside(journal, SystemMoment().unix_ms);
  if (!aside) return hal::Fail(aside.error());
  if (*aside) spdlog::error("the commit journal is damaged: moved to {}", (*aside)->string());
  return LockForDamagedJournals(journal);
}

void SettleWhatIsOpen(BenderDesk& desk, PartKeeper& keeper, AlarmBoard& alarms) {
  keeper.NameAfter(desk.LargestPartNumber());
  for (const SettledCommit& settled : desk.Resume()) {
    alarms.Begin(AlarmCode::kUncleanEnd, settled.session + ": " + settled.report.reason);
    keeper.Settle(settled);
  }
  const std::optional<std::string> open = desk.OpenCommit();
  for (const std::string& session : desk.ScansThatWaited()) {
    CommitReport report;
    // In the middle of its commit: the first look that the bender answers tells the end.
    const bool is_open = open == session;
    report.outcome = is_open ? CommitOutcome::kUnknown : CommitOutcome::kRefused;
    report.reason = is_open ? "the daemon ended in the middle of the commit; it is not known yet "
                              "what the bender holds"
                            : "nothing was sent: the daemon ended while the correction waited for "
                              "the bender";
    alarms.Begin(is_open ? AlarmCode::kCommitUnknown : AlarmCode::kUncleanEnd,
                 session + ": " + report.reason);
    desk.Note(session, is_open ? ScanFate::kUnknown : ScanFate::kDone, report.reason);
    keeper.Settle({session, report});
  }
  if (const auto last = desk.LastEnded()) keeper.KeepLost(*last);
}

}  // namespace bendloop::host
