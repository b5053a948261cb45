// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/tube_ledger.h"

#include <algorithm>
#include <utility>

#include "firmware-host/commit/commit_protocol.h"

namespace bendloop::host {
namespace {

// Nobody edits a program, bends with it and edits it back in so short a time; after a longer one
// in which the bender was not seen, the program that it shows tells nothing of what it bent.
constexpr std::int64_t kBlindAfterNs = 5'000'000'000;
// No press bends faster; a count that does is a count that was set.
constexpr std::int64_t kShortestCycleNs = 100'000'000;
// Kept in memory: those that may still be scanned, and then some.
constexpr std::size_t kMostTubes = 256;
constexpr std::size_t kMostPeriods = 256;

std::string Number(std::uint64_t number) { return std::to_string(number); }

}  // namespace

hal::Result<TubeLedger> TubeLedger::Open(const std::filesystem::path& journal,
                                         const LedgerRules& rules) {
  auto store = LedgerStore::Open(journal);
  if (!store) return hal::Fail(store.error());
  TubeLedger ledger(std::move(*store), rules);
  const auto change = ledger.store_.LastChange();
  if (!change) return hal::Fail(change.error());
  auto tubes = ledger.store_.Tubes(kMostTubes);
  if (!tubes) return hal::Fail(tubes.error());
  ledger.tubes_.assign(std::make_move_iterator(tubes->begin()),
                       std::make_move_iterator(tubes->end()));
  if (*change) {
    Sighting last;
    last.t_ns = INT64_MIN;
    last.active = (*change)->active;
    last.state.parts_bent = (*change)->parts_bent;
    last.state.active_part_number = last.active.part_number;
    last.state.active_sequence = last.active.sequence;
    ledger.last_ = std::move(last);
    ledger.last_is_restored_ = true;
    ledger.epoch_ = (*change)->epoch;
    ledger.periods_.push_back({INT64_MIN, (*change)->active, ledger.epoch_});
  }
  return ledger;
}

hal::Result<void> TubeLedger::Observe(const Sighting& now, const IsOurs& is_ours) {
  if (!now.consistent()) return {};
  std::vector<BentTube> tubes;
  std::string what = "first look";
  bool changed = true;
  std::uint64_t bent = 0;
  if (last_) {
    what.clear();
    changed = now.active != last_->active;
    const std::uint64_t modulus = rules_.count_modulus;
    bent = (now.state.parts_bent + modulus - last_->state.parts_bent) % modulus;
    if (rules_.counted && bent > 0) tubes = TubesSince(now, bent, changed, what);
  }
  std::uint64_t epoch = epoch_;
  bool ours = false;
  if (last_ && changed) {
    ours = is_ours && is_ours(last_->active, now.active);
    if (!ours) ++epoch;
    what += std::string(what.empty() ? "" : "; ") +
            (ours ? "our correction is active" : "another program was loaded or edited") + ": " +
            Describe(now.active);
  }
  hal::Result<void> kept;
  if (changed || bent > 0 || !last_) {
    kept = store_.Append({now.state.parts_bent, now.active, epoch, what}, tubes);
    // What could not be written is asked for again by the next look.
    if (!kept) return kept;
  }
  epoch_ = epoch;
  if (!tubes.empty() && tubes.front().doubt.rfind(kCountJumped, 0) == 0) {
    tubes_.clear();
    learnt_between_.reset();
  }
  for (BentTube& tube : tubes) tubes_.push_back(std::move(tube));
  while (tubes_.size() > kMostTubes) tubes_.pop_front();
  if (periods_.empty() || changed) periods_.push_back({now.t_ns, now.active, epoch_});
  while (periods_.size() > kMostPeriods) periods_.pop_front();
  TakeCycle(now, changed, ours, bent > 0);
  last_ = now;
  last_is_restored_ = false;
  return kept;
}

// A cycle that was seen to begin bends with what was active then, whatever is loaded before its
// end. Our own program comes between cycles only; somebody else's may come in the middle of one,
// and between the two reads of a look.
void TubeLedger::TakeCycle(const Sighting& now, bool changed, bool ours, bool bent) {
  const bool is_idle = now.state.mode == hal::BenderMode::kIdle;
  const bool is_near = last_ && !last_is_restored_ && now.t_ns - last_->t_ns <= kBlindAfterNs;
  if (is_idle || bent || !is_near) cycle_.reset();
  if (is_near && is_clean_ && !changed && !bent && !cycle_ &&
      now.state.mode == hal::BenderMode::kBending && last_->state.mode == hal::BenderMode::kIdle) {
    cycle_ = Period{now.t_ns, now.active, epoch_};
  }
  if (!is_near || (changed && !ours)) {
    is_clean_ = false;
  } else if (ours || is_idle || bent) {
    is_clean_ = true;
  }
}

std::vector<BentTube> TubeLedger::TubesSince(const Sighting& now, std::uint64_t bent, bool changed,
                                             std::string& what) const {
  const std::int64_t gap_ns = last_is_restored_ ? INT64_MAX : now.t_ns - last_->t_ns;
  const bool blind = gap_ns > kBlindAfterNs;
  const auto most = static_cast<std::uint64_t>(
      blind ? kMostTubes : 1 + static_cast<std::size_t>(gap_ns / kShortestCycleNs));
  BentTube tube;
  tube.after_ns = last_is_restored_ ? INT64_MIN : last_->asked_ns;
  tube.seen_ns = now.t_ns;
  tube.epoch = epoch_;
  if (bent > most) {
    tube.count = now.state.parts_bent;
    tube.doubt = std::string(kCountJumped) + " from " + Number(last_->state.parts_bent) + " to " +
                 Number(now.state.parts_bent);
    what = tube.doubt;
    return {tube};
  }
  what = Number(bent) + (bent == 1 ? " tube was bent" : " tubes were bent");
  if (bent == 1 && !blind && cycle_) {
    tube.program = cycle_->program;
    tube.epoch = cycle_->epoch;
  } else if (blind) {
    tube.doubt = "it was bent while the bender could not be followed";
  } else if (changed || !is_clean_) {
    tube.doubt = "the program was changed about when it was bent";
  } else {
    tube.program = now.active;
  }
  std::vector<BentTube> tubes(static_cast<std::size_t>(bent), tube);
  for (std::uint64_t i = 0; i < bent; ++i) {
    tubes[i].count =
        static_cast<std::uint32_t>((last_->state.parts_bent + i + 1) % rules_.count_modulus);
  }
  return tubes;
}

hal::Result<void> TubeLedger::Use(const std::string& session, const TubeMatch& match,
                                  const std::optional<TubeName>& name) {
  if (!match.tube) {
    // Only the scan tells of this tube.
    BentTube tube;
    tube.program = match.bent_with;
    tube.epoch = epoch_;
    tube.used = true;
    tube.session = session;
    for (const BentTube& known : tubes_) {
      if (known.session == session) return {};
    }
    auto kept = store_.AppendUse(session, tube, name);
    if (kept) tubes_.push_back(std::move(tube));
    while (tubes_.size() > kMostTubes) tubes_.pop_front();
    return kept;
  }
  for (const BentTube& tube : tubes_) {
    if (tube.id != *match.tube || !tube.used) continue;
    if (tube.session == session) return {};
    return hal::Fail(hal::ErrorKind::kRefused,
                     "the tube has been used up by " +
                         (tube.session.empty() ? std::string("a later scan") : tube.session));
  }
  if (auto kept = store_.AppendUse(session, *match.tube, "", name); !kept) return kept;
  std::uint64_t after = 0;
  for (BentTube& tube : tubes_) {
    if (tube.id > *match.tube) ++after;
    if (tube.id <= *match.tube) tube.used = true;
    if (tube.id == *match.tube) tube.session = session;
  }
  if (!rules_.parts_between && !learnt_between_) learnt_between_ = after;
  return {};
}

hal::Result<void> TubeLedger::PassOver(const std::string& session, const TubeMatch& match,
                                       const std::optional<TubeName>& name) {
  if (!match.tube) return {};
  if (auto kept = store_.AppendUse(session, *match.tube, "not certain", name); !kept) {
    return kept;
  }
  for (BentTube& tube : tubes_) {
    if (tube.id <= *match.tube) tube.used = true;
    if (tube.id == *match.tube) tube.session = session;
  }
  return {};
}

hal::Result<void> TubeLedger::Note(const std::string& session, ScanFate fate,
                                   const std::string& detail) {
  std::optional<std::int64_t> id;
  for (const BentTube& tube : tubes_) {
    if (tube.session == session) id = tube.id;
  }
  return store_.Append(session, id, fate, detail);
}

}  // namespace bendloop::host
