// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include "firmware-host/ledger/tube_ledger.h"

namespace bendloop::host {
namespace {

using pipeline::InterlockKind;
using pipeline::TubeCheck;

std::string NameOf(const BentTube& tube) {
  return tube.count ? "tube " + std::to_string(*tube.count) + " of the bender's count"
                    : "the tube of " + tube.session;
}

void Add(TubeMatch& match, InterlockKind kind, bool passed, std::string found, std::string mend) {
  match.checks.push_back({kind, passed, std::move(found), std::move(mend)});
}

}  // namespace

bool TubeMatch::passed() const {
  return std::all_of(checks.begin(), checks.end(),
                     [](const TubeCheck& check) { return check.passed; });
}

TubeMatch TubeLedger::Match(const ScanToMatch& scan) const {
  TubeMatch match = rules_.counted ? MatchCounted(scan) : MatchEachScan(scan);
  return scan.name ? MatchByName(scan, std::move(match)) : match;
}

// A name that was used up is that tube once more, whatever was bent since; and what is by the count
// a tube once more, and has another name, is another one.
TubeMatch TubeLedger::MatchByName(const ScanToMatch& scan, TubeMatch by_count) const {
  const auto session = store_.SessionOf(*scan.name, scan.session);
  const auto known = by_count.repeats ? store_.NameOf(*by_count.repeats)
                                      : hal::Result<std::optional<TubeName>>(std::nullopt);
  if (!session || !known) {
    TubeMatch match;
    Add(match, InterlockKind::kNewTube, false,
        "whether the tube was scanned before cannot be told: " +
            (session ? known : hal::Fail(session.error())).error().message,
        "check the disk, then scan it again");
    return match;
  }
  if (*session) {
    TubeMatch match;
    Add(match, InterlockKind::kNewTube, false,
        "the tube says that it is '" + scan.name->name + "', which was scanned as " + **session,
        "the same tube must not be corrected twice; scan the next one");
    match.repeats = **session;
    return match;
  }
  if (!*known) return by_count;
  by_count.repeats.reset();
  Add(by_count, InterlockKind::kTubeIdentity, false,
      "the tube says that it is '" + scan.name->name + "', expected '" + (*known)->name + "'",
      "another tube was laid in; scan the tubes in the order in which they were bent");
  return by_count;
}

// What the bender must hold now for a correction of this tube to be its next program.
void TubeLedger::Expect(const BentTube& tube, TubeMatch& match) const {
  match.bent_with = tube.program;
  if (!tube.program || !last_) return;
  match.expected = tube.epoch == epoch_ ? last_->active : *tube.program;
}

std::size_t TubeLedger::FirstUnused() const {
  const auto used =
      std::find_if(tubes_.rbegin(), tubes_.rend(), [](const BentTube& tube) { return tube.used; });
  return static_cast<std::size_t>(tubes_.rend() - used);
}

// The tube that lies `parts_between` before the newest one of when the scan began. A tube whose end
// was seen only after the scan had begun may be one of before or of after it: the later of the two
// readings is taken, for who takes the earlier one might let a tube be corrected twice; and none,
// where the earlier reading is a tube that has been scanned.
TubeLedger::Place TubeLedger::TubeAt(std::int64_t began_ns) const {
  const std::size_t first = FirstUnused();
  std::size_t most = 0;
  std::size_t least = 0;
  for (std::size_t i = 0; i < tubes_.size(); ++i) {
    if (tubes_[i].seen_ns <= began_ns) least = i + 1;
    if (tubes_[i].after_ns < began_ns) most = i + 1;
  }
  std::size_t between = most > first ? most - first - 1 : 0;
  if (learnt_between_) between = static_cast<std::size_t>(*learnt_between_);
  if (rules_.parts_between) between = static_cast<std::size_t>(*rules_.parts_between);
  for (std::size_t bent = most; bent > between && bent >= least; --bent) {
    const std::size_t at = bent - between - 1;
    if (at < first) break;
    const bool was_scanned = least > between && least - between - 1 < first;
    return {&tubes_[at], at - first, bent > least && was_scanned};
  }
  return {};
}

// The same scan again, as after a wait for the bender.
bool TubeLedger::MatchAgain(const std::string& session, TubeMatch& match) const {
  for (const BentTube& tube : tubes_) {
    if (!tube.used || tube.session != session || !tube.program) continue;
    Add(match, InterlockKind::kNewTube, true, NameOf(tube) + " has not been scanned before", "");
    Add(match, InterlockKind::kTubeProgram, true, "the program that bent it is known", "");
    match.tube = tube.id;
    Expect(tube, match);
    return true;
  }
  return false;
}

// No tube is new to this scan. With none between bender and scan it is the last one again. With
// some it may as well be the next of those, as at the end of a batch: nobody can tell, and who took
// it for the next one would learn twice from one that is scanned twice.
void TubeLedger::HoldWithoutTube(TubeMatch& match) const {
  const std::uint64_t between = rules_.parts_between.value_or(learnt_between_.value_or(0));
  std::string found = "no new tube was bent before this scan";
  const auto used =
      std::find_if(tubes_.rbegin(), tubes_.rend(), [](const BentTube& tube) { return tube.used; });
  if (used == tubes_.rend()) {
    if (between > 0) {
      found +=
          " (" + std::to_string(between) + " lie between bender and scan, as parts_between says)";
    }
    Add(match, InterlockKind::kNewTube, false, std::move(found),
        "bend and scan the next one, or set parts_between to how many tubes lie between bender and "
        "scan");
    return;
  }
  const std::string last =
      NameOf(*used) + (used->session.empty() || !used->count ? "" : ", " + used->session);
  if (between > 0) {
    Add(match, InterlockKind::kNewTube, false,
        found + ": it shows the last one scanned again (" + last + ") or one of the " +
            std::to_string(between) + " that lie between bender and scan",
        "the last tubes of a batch are measured and judged, and nothing is learnt from them; for "
        "more bend and scan the next one");
    return;
  }
  if (!used->session.empty()) match.repeats = used->session;
  Add(match, InterlockKind::kNewTube, false, found + "; the last one scanned is " + last,
      "the same tube must not be corrected twice; bend and scan the next one");
}

// Which of the tubes not scanned it is matters only where they were bent with different programs.
bool TubeLedger::AreAlikeUpTo(const BentTube& tube) const {
  return std::all_of(tubes_.begin(), tubes_.end(), [&tube](const BentTube& other) {
    const bool is_jump = other.doubt.rfind(kCountJumped, 0) == 0;  // and no tube that lies about
    if (other.used || is_jump || other.id >= tube.id) return true;
    return other.program && other.program == tube.program;
  });
}

TubeMatch TubeLedger::MatchCounted(const ScanToMatch& scan) const {
  TubeMatch match;
  if (!last_ || last_is_restored_) {
    Add(match, InterlockKind::kTubeCount, false, "the bender has not told its count of tubes yet",
        "check the link and that the controller runs, then bend and scan a new tube");
    return match;
  }
  if (MatchAgain(scan.session, match)) return match;
  const auto [tube, unscanned_before, is_just_bent] = TubeAt(scan.began_ns);
  if (tube == nullptr) {
    HoldWithoutTube(match);
    return match;
  }
  if (is_just_bent) {
    Add(match, InterlockKind::kNewTube, false,
        NameOf(*tube) +
            " was counted just when the scan began, so that this may as well be the "
            "last one again",
        "scan it once more");
    return match;
  }
  Add(match, InterlockKind::kNewTube, true, NameOf(*tube) + " has not been scanned before", "");
  match.tube = tube->id;
  if (tube->doubt.rfind(kCountJumped, 0) == 0) {
    Add(match, InterlockKind::kTubeCount, false, tube->doubt,
        "which tube this is cannot be told; bend and scan a new one");
  } else if (!tube->program) {
    Add(match, InterlockKind::kTubeProgram, false,
        "with which program " + NameOf(*tube) + " was bent is not known: " + tube->doubt,
        "bend and scan another tube");
  } else if (unscanned_before > 0 && !AreAlikeUpTo(*tube)) {
    Add(match, InterlockKind::kTubeProgram, false,
        "of the " + std::to_string(unscanned_before) + " bent before " + NameOf(*tube) +
            " and not scanned some were bent with another program, so which one this is is not "
            "certain",
        "scan the next tube, or set parts_between to how many tubes lie between bender and scan");
  } else {
    Add(match, InterlockKind::kTubeProgram, true, "the program that bent it is known", "");
    Expect(*tube, match);
  }
  return match;
}

// The tube was bent with what was active when its scan began; nothing else tells of it.
TubeMatch TubeLedger::MatchEachScan(const ScanToMatch& scan) const {
  TubeMatch match;
  const Period* bent = nullptr;
  for (const Period& period : periods_) {
    if (bent == nullptr || period.seen_ns <= scan.began_ns) bent = &period;
  }
  if (bent == nullptr || !last_ || last_is_restored_) {
    Add(match, InterlockKind::kTubeProgram, false, "the bender has not told its program yet",
        "check the link and that the controller runs, then scan the next tube");
    return match;
  }
  Add(match, InterlockKind::kNewTube, true, "each scan is taken for a new tube, as tubes says", "");
  BentTube tube;
  tube.program = bent->program;
  tube.epoch = bent->epoch;
  Expect(tube, match);
  return match;
}

TubeMatch TubeLedger::MatchRecorded(const std::string& session, std::int64_t id) const {
  TubeMatch match;
  const auto found = std::find_if(tubes_.begin(), tubes_.end(),
                                  [id](const BentTube& tube) { return tube.id == id; });
  if (found == tubes_.end() || found->used || !found->program) {
    Add(match, InterlockKind::kNewTube, false,
        "the tube of " + session + " has been scanned, or other tubes after it, since",
        "bend and scan a new one");
    return match;
  }
  Add(match, InterlockKind::kNewTube, true, NameOf(*found) + " has not been scanned before", "");
  match.tube = id;
  Expect(*found, match);
  return match;
}

}  // namespace bendloop::host
