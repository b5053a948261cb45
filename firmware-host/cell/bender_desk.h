// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "config/cell_config.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/commit/commit_protocol.h"
#include "firmware-host/ledger/moment.h"
#include "firmware-host/ledger/tube_ledger.h"
#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/result.h"
#include "pipeline/correction/interlocks.h"

namespace bendloop::host {

// What the bender said when it was asked.
struct BenderReading {
  std::optional<pipeline::BenderFacts> facts;  // empty: it did not answer
  std::string problem;                         // why not
  bool is_journals = false;  // the problem is the journal's, which nothing may be done without
};

// How an earlier commit ended whose end was not known.
struct SettledCommit {
  std::string session;
  CommitReport report;
};

// The cell's one place to talk with its bender: link, commit protocol, journal and tube ledger
// together, and the simulated bender itself where the cell file asks for one. Whatever is read of
// the bender, by whom and for what, the ledger sees. Any thread may call; one at a time is served.
class BenderDesk {
 public:
  struct Options {
    std::filesystem::path journal;  // ":memory:" keeps nothing
    // Simulated bender: active at its start.
    hal::ProgramBlock preload;
    double pipe_radius_mm = 0;
    CommitOptions commit;
    LedgerRules ledger = {};
    bool read_only = false;  // nothing is ever sent
    std::function<Moment()> moment = SystemMoment;
  };

  // `clock` must outlive the desk. A bender that does not answer is no error: it may come later.
  static hal::Result<std::unique_ptr<BenderDesk>> Open(const config::BenderConfig& bender,
                                                       const Options& options, hal::Clock& clock);
  // The same on a link that is there.
  static hal::Result<std::unique_ptr<BenderDesk>> Open(std::unique_ptr<hal::BenderLink> link,
                                                       const Options& options, hal::Clock& clock);
  ~BenderDesk();

  bool has_bender() const { return link_ != nullptr; }
  bool counts_tubes() const { return options_.ledger.counted; }
  bool read_only() const { return options_.read_only; }
  const std::string& name() const { return name_; }  // for the log
  Moment Now() const { return options_.moment(); }
  // The longest that one exchange with the bender may take.
  std::chrono::nanoseconds exchange_bound() const { return exchange_bound_; }
  // Told before each exchange of a commit: it goes on. From the thread that commits.
  void set_progress(std::function<void()> progress) { progress_ = std::move(progress); }

  // Shows the PLC what it reads of the cell (hal::BenderLink::Report); never between the steps of a
  // commit. Does nothing where it reads nothing, or where nothing may be sent.
  hal::Result<void> Report(const hal::CellReport& report);
  // State and active program; the ledger takes note, and a commit whose end is open is settled.
  BenderReading Look();
  CommitReport Commit(const CommitRequest& request);
  // Ends a commit that a crash or a lost link left open; also what TakeSettled would give.
  std::list<SettledCommit> Resume();
  // The session whose commit is open still: what the bender holds is not known.
  std::optional<std::string> OpenCommit() const;
  // Moves what Look and Commit have settled since behind `to`. Needs no memory.
  void TakeSettled(std::list<SettledCommit>& to);

  TubeMatch Match(const ScanToMatch& scan) const;
  TubeMatch MatchRecorded(const std::string& session, std::int64_t tube) const;
  hal::Result<void> Use(const std::string& session, const TubeMatch& match,
                        const std::optional<TubeName>& name);
  hal::Result<void> PassOver(const std::string& session, const TubeMatch& match,
                             const std::optional<TubeName>& name);
  void Note(const std::string& session, ScanFate fate, const std::string& detail);
  // Scans whose correction waited for the bender when the process ended.
  std::vector<std::string> ScansThatWaited() const;

  // Those whose correction is still to be sent, or may be on its way: nothing of them may go.
  hal::Result<std::set<std::string>> SessionsInHand() const;
  // Drops what the journal knows of long ago (ledger/journal_retention.h).
  hal::Result<void> DropOld(double most_days);

  // False when the journal cannot tell; then the commit itself will fail with the reason.
  bool SessionCommitted(const std::string& session) const;
  std::uint32_t LastSequence() const;
  // The last program that was sent and became active, with the one before it.
  std::optional<CommitAttempt> LastAttempt() const;
  // The last program that was sent, if it is known how that ended.
  std::optional<CommitAttempt> LastEnded() const;
  // 7 when "part-0007" is the last scan that the journal knows.
  unsigned LargestPartNumber() const;
  // The bender broke a rule and nobody has acknowledged: nothing is sent. Empty: it may be.
  std::string Locked() const;
  hal::Result<void> Acknowledge(const std::string& who);
  // Takes over the number of a recorded run.
  void NoteSequence(std::uint32_t sequence);

 private:
  struct Simulator;
  class ObservedLink;
  BenderDesk(CommitJournal journal, TubeLedger ledger, const Options& options);
  static hal::Result<std::unique_ptr<BenderDesk>> OpenWithout(const Options& options);
  void Attach(std::unique_ptr<hal::BenderLink> link, hal::Clock& clock);
  void Saw(const Sighting& sighting);
  BenderReading Read();
  bool Settle();
  bool TellEnds(std::int64_t before);
  void Tell(SettledCommit end);

  const Options options_;
  std::string name_;
  std::chrono::nanoseconds exchange_bound_{0};
  std::function<void()> progress_;

  mutable std::mutex mutex_;  // of all below
  CommitJournal journal_;
  TubeLedger ledger_;
  std::unique_ptr<Simulator> simulator_;
  std::unique_ptr<hal::BenderLink> link_;
  std::unique_ptr<CommitProtocol> protocol_;
  bool connected_ = false;
  bool takes_report_ = false;
  bool is_open_ = true;  // a commit's end may be, or nobody was told it
  bool commits_ = false;
  std::int64_t told_up_to_ = 0;  // attempt: its end was told, and those of all before it
  std::string ledger_problem_;
  std::list<SettledCommit> settled_;
};

// Of a map's counter of tubes: as many as it counts before it is 0 again.
std::uint64_t CountModulus(const hal::RegisterMap& map);

}  // namespace bendloop::host
