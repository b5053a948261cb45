// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "firmware-host/ledger/ledger_store.h"
#include "hal/bend_program.h"
#include "hal/bender_state.h"
#include "hal/result.h"
#include "pipeline/correction/interlocks.h"

namespace bendloop::host {

// What the bender showed in one look: its state, then its active program.
struct Sighting {
  std::int64_t asked_ns = 0;  // by the ledger's clock, before the state was read
  std::int64_t t_ns = 0;      // and after
  hal::BenderState state;
  hal::ProgramBlock active;

  // The state and the program are of one moment, as far as they tell.
  bool consistent() const {
    return state.active_part_number == active.part_number &&
           state.active_sequence == active.sequence;
  }
};

struct LedgerRules {
  // By the bender's count; false: each scan is a new tube, as the cell file says.
  bool counted = true;
  // So many tubes were bent after the one that is scanned; empty: as many as at the first scan.
  std::optional<std::uint64_t> parts_between = 0;
  std::uint64_t count_modulus = std::uint64_t{1} << 32;  // of the register that counts
};

// Which tube a scan shows, and with what it was bent.
struct TubeMatch {
  std::optional<std::int64_t> tube;  // the ledger's id; empty: none, or one that begins with Use
  std::optional<hal::ProgramBlock> bent_with;
  // What the bender must hold now; differs from `bent_with` by our own corrections alone.
  std::optional<hal::ProgramBlock> expected;
  std::vector<pipeline::TubeCheck> checks;
  // The scan whose tube this is again, as far as the count tells.
  std::optional<std::string> repeats;

  bool passed() const;
};

// Which scan is asked about.
struct ScanToMatch {
  std::string session;
  std::int64_t began_ns = 0;  // by the ledger's clock
  // Where somebody tells tubes apart.
  std::optional<TubeName> name = {};
};

// The journalled ledger of bent tubes (README.md): what the bender was seen doing goes in by
// Observe, a scan finds its tube by Match and uses it up by Use. Not thread-safe; its owner is the
// bender's desk.
class TubeLedger {
 public:
  static hal::Result<TubeLedger> Open(const std::filesystem::path& journal,
                                      const LedgerRules& rules);

  // `is_ours(from, to)`: it was our own commit that made `to` out of `from`.
  using IsOurs = std::function<bool(const hal::ProgramBlock&, const hal::ProgramBlock&)>;
  hal::Result<void> Observe(const Sighting& sighting, const IsOurs& is_ours);

  TubeMatch Match(const ScanToMatch& scan) const;
  // The tube of a recorded scan, by the id that the ledger gave it then.
  TubeMatch MatchRecorded(const std::string& session, std::int64_t tube) const;

  // Uses up the matched tube, with its name where it has one, and passes over those bent before it.
  // kRefused when it is used up already. The same session may come again.
  hal::Result<void> Use(const std::string& session, const TubeMatch& match,
                        const std::optional<TubeName>& name = {});
  // A scan whose tube is not certain: none of those that it may be is taken by a later scan.
  hal::Result<void> PassOver(const std::string& session, const TubeMatch& match,
                             const std::optional<TubeName>& name = {});
  hal::Result<void> Note(const std::string& session, ScanFate fate, const std::string& detail);
  hal::Result<std::vector<std::string>> Sessions(ScanFate fate) const {
    return store_.Sessions(fate);
  }

  const std::optional<Sighting>& last() const { return last_; }
  const std::deque<BentTube>& tubes() const { return tubes_; }
  std::uint64_t epoch() const { return epoch_; }

 private:
  TubeLedger(LedgerStore store, const LedgerRules& rules)
      : store_(std::move(store)), rules_(rules) {}

  struct Period {  // in which one program was active
    std::int64_t seen_ns = INT64_MIN;
    hal::ProgramBlock program;
    std::uint64_t epoch = 0;
  };

  std::vector<BentTube> TubesSince(const Sighting& now, std::uint64_t bent, bool changed,
                                   std::string& what) const;
  void TakeCycle(const Sighting& now, bool changed, bool ours, bool bent);
  TubeMatch MatchByName(const ScanToMatch& scan, TubeMatch by_count) const;
  TubeMatch MatchCounted(const ScanToMatch& scan) const;
  TubeMatch MatchEachScan(const ScanToMatch& scan) const;
  bool MatchAgain(const std::string& session, TubeMatch& match) const;
  void HoldWithoutTube(TubeMatch& match) const;
  bool AreAlikeUpTo(const BentTube& tube) const;
  struct Place {
    const BentTube* tube = nullptr;
    std::size_t unscanned_before = 0;
    bool is_just_bent = false;  // and may as well be the last one, scanned again
  };
  Place TubeAt(std::int64_t began_ns) const;
  void Expect(const BentTube& tube, TubeMatch& match) const;
  std::size_t FirstUnused() const;

  LedgerStore store_;
  LedgerRules rules_;
  std::optional<std::uint64_t> learnt_between_;  // with parts_between = auto
  std::optional<Sighting> last_;
  bool last_is_restored_ = false;
  std::uint64_t epoch_ = 0;
  std::deque<BentTube> tubes_;
  std::deque<Period> periods_;
  // Of the cycle that runs, once it was seen to run: what it began with.
  std::optional<Period> cycle_;
  // A cycle that begins from the last look on begins with the program that it showed: since
  // somebody's change the bender was seen idle, or to end a cycle.
  bool is_clean_ = false;
};

}  // namespace bendloop::host
