// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "config/cell_config.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/commit/commit_protocol.h"
#include "hal/bender_link.h"
#include "hal/clock.h"
#include "hal/result.h"
#include "pipeline/correction/interlocks.h"

namespace bendloop::host {

// What the bender said when it was asked.
struct BenderReading {
  std::optional<pipeline::BenderFacts> facts;  // empty: it did not answer
  std::string problem;                         // why not
};

// The cell's one place to talk with its bender: link, commit protocol and journal together, and the
// simulated bender itself where the cell file asks for one. Not thread-safe; hand it over whole.
class BenderDesk {
 public:
  struct Options {
    std::filesystem::path journal;  // ":memory:" keeps nothing
    // Simulated bender: active at its start.
    hal::ProgramBlock preload;
    double pipe_radius_mm = 0;
    CommitOptions commit;
  };

  // `clock` must outlive the desk. A bender that does not answer is no error: it may come later.
  static hal::Result<std::unique_ptr<BenderDesk>> Open(const config::BenderConfig& bender,
                                                       const Options& options, hal::Clock& clock);
  ~BenderDesk();

  bool has_bender() const { return link_ != nullptr; }
  const std::string& name() const { return name_; }  // for the log

  BenderReading Read();
  CommitReport Commit(const CommitRequest& request);
  std::optional<CommitReport> Resume();
  // False when the journal cannot tell; then the commit itself will fail with the reason.
  bool SessionCommitted(const std::string& session) const;
  std::uint32_t LastSequence() const;
  // Takes over the number of a recorded run.
  void NoteSequence(std::uint32_t sequence);

 private:
  struct Simulator;
  explicit BenderDesk(CommitJournal journal);

  std::string name_;
  CommitJournal journal_;
  std::unique_ptr<Simulator> simulator_;
  std::unique_ptr<hal::BenderLink> link_;
  std::unique_ptr<CommitProtocol> protocol_;
  bool connected_ = false;
};

}  // namespace bendloop::host
