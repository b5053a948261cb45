// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_desk.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "drivers/register_bender/register_bender.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "firmware-host/cell/bender_carrier.h"
#include "firmware-host/ledger/journal_retention.h"
#include "hal/scope_exit.h"

namespace bendloop::host {
namespace {

constexpr std::int64_t kNoAttempt = std::numeric_limits<std::int64_t>::max();

// Reading a whole program of the largest size, each answer at the last moment, after connecting
// anew, and as long again for a serial line that is listened to until it is quiet.
std::chrono::nanoseconds ExchangeBound(const config::BenderConfig& bender) {
  constexpr int kHeadRequests = 8;
  const hal::RegisterMap& map = bender.register_map;
  const int registers = map.max_rows * std::max<int>(map.row_stride, 1);
  const int least = std::max<int>(std::min(map.max_read_registers, map.max_write_registers), 1);
  const int requests = kHeadRequests + registers / least;
  return 2 * (bender.connect_timeout + requests * bender.response_timeout);
}

}  // namespace

struct BenderDesk::Simulator {
  std::unique_ptr<drivers::SimulatedBender> bender;
};

// The desk's link: shows the ledger each pair of state and active program that anybody reads, so
// that none of the commit's own readings is lost to it.
class BenderDesk::ObservedLink final : public hal::BenderLink {
 public:
  ObservedLink(std::unique_ptr<hal::BenderLink> link, BenderDesk& desk)
      : link_(std::move(link)), desk_(desk) {}

  hal::Result<hal::BenderInfo> Connect() override { return Go().Connect(); }
  hal::Result<hal::BenderState> ReadState() override {
    seen_.asked_ns = desk_.Now().boot_ns;
    auto state = Go().ReadState();
    seen_.t_ns = desk_.Now().boot_ns;
    has_state_ = state.has_value();
    if (state) seen_.state = *state;
    return state;
  }
  hal::Result<hal::ProgramBlock> ReadActive() override {
    auto active = Go().ReadActive();
    // A state is good for one program: the next look begins with a state of its own.
    if (active && has_state_) {
      seen_.active = *active;
      desk_.Saw(seen_);
    }
    has_state_ = false;
    return active;
  }
  // Not for the ledger: what has no crc that fits has bent nothing yet.
  hal::Result<hal::ProgramBlock> ReadActiveAsItStands() override {
    has_state_ = false;
    return Go().ReadActiveAsItStands();
  }
  hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
    return link_->Encode(block);
  }
  hal::Result<void> Stage(const hal::ProgramBlock& block) override { return Go().Stage(block); }
  hal::Result<hal::ProgramBlock> ReadStaged() override { return Go().ReadStaged(); }
  hal::Result<void> Commit(std::uint32_t sequence) override {
    has_state_ = false;
    return Go().Commit(sequence);
  }
  hal::Result<void> Report(const hal::CellReport& report) override { return Go().Report(report); }

 private:
  hal::BenderLink& Go() {
    if (desk_.commits_ && desk_.progress_) desk_.progress_();
    return *link_;
  }

  std::unique_ptr<hal::BenderLink> link_;
  BenderDesk& desk_;
  Sighting seen_;
  bool has_state_ = false;
};

BenderDesk::BenderDesk(CommitJournal journal, TubeLedger ledger, const Options& options)
    : options_(options), journal_(std::move(journal)), ledger_(std::move(ledger)) {}
BenderDesk::~BenderDesk() = default;

hal::Result<std::unique_ptr<BenderDesk>> BenderDesk::OpenWithout(const Options& options) {
  auto journal = CommitJournal::Open(options.journal);
  if (!journal) return hal::Fail(journal.error());
  const auto told = journal->LastEnd();
  if (!told) return hal::Fail(told.error());
  auto ledger = TubeLedger::Open(options.journal, options.ledger);
  if (!ledger) return hal::Fail(ledger.error());
  std::unique_ptr<BenderDesk> desk(
      new BenderDesk(std::move(*journal), std::move(*ledger), options));
  desk->told_up_to_ = *told;
  return desk;
}

void BenderDesk::Attach(std::unique_ptr<hal::BenderLink> link, hal::Clock& clock) {
  link_ = std::make_unique<ObservedLink>(std::move(link), *this);
  protocol_ = std::make_unique<CommitProtocol>(*link_, journal_, clock, options_.commit);
}

hal::Result<std::unique_ptr<BenderDesk>> BenderDesk::Open(std::unique_ptr<hal::BenderLink> link,
                                                          const Options& options,
                                                          hal::Clock& clock) {
  auto desk = OpenWithout(options);
  if (desk) (*desk)->Attach(std::move(link), clock);
  return desk;
}

hal::Result<std::unique_ptr<BenderDesk>> BenderDesk::Open(const config::BenderConfig& bender,
                                                          const Options& options,
                                                          hal::Clock& clock) {
  auto opened = OpenWithout(options);
  if (!opened) return hal::Fail(opened.error());
  std::unique_ptr<BenderDesk> desk = std::move(*opened);
  if (bender.link == config::BenderKind::kNone) {
    desk->name_ = "none";
    return desk;
  }
  desk->exchange_bound_ = ExchangeBound(bender);
  config::BenderConfig reached = bender;
  if (bender.link == config::BenderKind::kSimulated) {
    drivers::SimulatedBenderOptions simulated;
    simulated.map = bender.register_map;
    simulated.program = options.preload;
    simulated.pipe_radius_mm = options.pipe_radius_mm;
    auto started = drivers::SimulatedBender::Start(std::move(simulated));
    if (!started) return hal::Fail(started.error());
    reached.link = config::BenderKind::kModbusTcp;
    reached.host = "127.0.0.1";
    reached.port = (*started)->port();
    desk->simulator_ = std::make_unique<Simulator>(Simulator{std::move(*started)});
  }
  desk->name_ = desk->simulator_ ? "simulated" : BenderCarrierName(reached);
  desk->Attach(drivers::MakeRegisterBender(reached.register_map, MakeBenderCarrier(reached, clock)),
               clock);
  return desk;
}

// Reads a pair for whoever asks; the caller holds the lock.
BenderReading BenderDesk::Read() {
  if (!link_) return {std::nullopt, "the cell has no bender"};
  if (!connected_) {
    const auto info = link_->Connect();
    if (!info) return {std::nullopt, info.error().message};
    connected_ = true;
    takes_report_ = info->takes_report;
  }
  const auto state = link_->ReadState();
  if (!state) return {std::nullopt, state.error().message};
  protocol_->Observe(*state);
  auto active = link_->ReadActive();
  if (!active) return {std::nullopt, active.error().message};
  if (!ledger_problem_.empty()) return {std::nullopt, ledger_problem_, true};
  if (!options_.read_only) protocol_->ObserveActive(*active);
  return {pipeline::BenderFacts{*state, std::move(*active)}, ""};
}

void BenderDesk::Saw(const Sighting& sighting) {
  const auto kept = ledger_.Observe(sighting, [this](const auto& from, const auto& to) {
    return journal_.Proposed(from, to).value_or(false);
  });
  ledger_problem_ = kept ? "" : kept.error().message;
}

BenderReading BenderDesk::Look() {
  const std::lock_guard lock(mutex_);
  BenderReading now = Read();
  if (!now.facts || !is_open_ || options_.read_only) return now;
  if (Settle()) now = Read();
  return now;
}

hal::Result<void> BenderDesk::Report(const hal::CellReport& report) {
  const std::lock_guard lock(mutex_);
  if (!connected_ || !takes_report_ || options_.read_only) return {};
  return link_->Report(report);
}

CommitReport BenderDesk::Commit(const CommitRequest& request) {
  const std::lock_guard lock(mutex_);
  if (options_.read_only) {
    CommitReport report;
    report.outcome = CommitOutcome::kRefused;
    report.reason = "nothing was sent: a replay sends to a real bender with --send alone";
    return report;
  }
  if (is_open_) Settle();
  // What is thrown in the middle, for want of memory, leaves an attempt that the next look settles,
  // as after a crash; and what is thrown at the end, one whose end the next look tells.
  const bool was_open = std::exchange(is_open_, true);
  commits_ = true;
  const hal::ScopeExit over([this] { commits_ = false; });
  CommitReport report = protocol_->Commit(request);
  const bool is_known = report.attempt > 0 && report.outcome != CommitOutcome::kUnknown;
  // Another's end that it found on its way is told before this one's.
  const std::int64_t own = report.attempt > 0 ? report.attempt : kNoAttempt;
  const bool are_told = !was_open || TellEnds(own);
  // The journal may not have taken this one's, for want of memory or disk: the next look ends it
  // there.
  const auto left = journal_.Unfinished();
  if (is_known && are_told) told_up_to_ = report.attempt;
  is_open_ = !are_told || !left || *left;
  return report;
}

// Ends what is open, and tells what nobody was told; false: nothing, or it cannot be told yet.
// Where it throws for want of memory the next call tells.
bool BenderDesk::Settle() {
  SettledCommit last;
  auto resumed = protocol_->Resume(&last.session);
  const bool is_known = resumed && resumed->outcome != CommitOutcome::kUnknown;
  const std::int64_t before = told_up_to_;
  const bool are_told = TellEnds(is_known ? resumed->attempt : kNoAttempt);
  if (is_known && are_told && resumed->attempt > told_up_to_) {
    last.report = std::move(*resumed);
    Tell(std::move(last));
  }
  const auto left = journal_.Unfinished();
  is_open_ = !are_told || !left || *left;
  return is_known || told_up_to_ > before;
}

// The ends that the journal has of attempts before this one; false: it cannot be read.
bool BenderDesk::TellEnds(std::int64_t before) {
  const auto ends = journal_.EndsAfter(told_up_to_);
  if (!ends) return false;
  for (const CommitAttempt& end : *ends) {
    if (end.id < before) Tell({end.session, EndOf(end)});
  }
  return true;
}

// By TakeSettled. Its room is taken before it counts as told: there is no second time.
void BenderDesk::Tell(SettledCommit end) {
  std::list<SettledCommit> room;
  room.push_back(std::move(end));
  const CommitReport& report = room.front().report;
  const bool is_active = report.outcome == CommitOutcome::kCommitted;
  static_cast<void>(ledger_.Note(
      room.front().session, is_active ? ScanFate::kCorrected : ScanFate::kDone, report.reason));
  told_up_to_ = report.attempt;
  settled_.splice(settled_.end(), room);
}

std::list<SettledCommit> BenderDesk::Resume() {
  const std::lock_guard lock(mutex_);
  if (protocol_ && !options_.read_only) Settle();
  return std::exchange(settled_, {});
}

std::optional<std::string> BenderDesk::OpenCommit() const {
  const std::lock_guard lock(mutex_);
  const auto unfinished = journal_.Unfinished();
  if (!unfinished || !*unfinished) return std::nullopt;
  return (*unfinished)->session;
}

void BenderDesk::TakeSettled(std::list<SettledCommit>& to) {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (lock) to.splice(to.end(), settled_);
}

TubeMatch BenderDesk::Match(const ScanToMatch& scan) const {
  const std::lock_guard lock(mutex_);
  return ledger_.Match(scan);
}

TubeMatch BenderDesk::MatchRecorded(const std::string& session, std::int64_t tube) const {
  const std::lock_guard lock(mutex_);
  return ledger_.MatchRecorded(session, tube);
}

hal::Result<void> BenderDesk::Use(const std::string& session, const TubeMatch& match,
                                  const std::optional<TubeName>& name) {
  const std::lock_guard lock(mutex_);
  return ledger_.Use(session, match, name);
}

hal::Result<void> BenderDesk::PassOver(const std::string& session, const TubeMatch& match,
                                       const std::optional<TubeName>& name) {
  const std::lock_guard lock(mutex_);
  return ledger_.PassOver(session, match, name);
}

void BenderDesk::Note(const std::string& session, ScanFate fate, const std::string& detail) {
  const std::lock_guard lock(mutex_);
  // What must be kept stands in the journal's steps and in the tube's use.
  static_cast<void>(ledger_.Note(session, fate, detail));
}

std::vector<std::string> BenderDesk::ScansThatWaited() const {
  const std::lock_guard lock(mutex_);
  return ledger_.Sessions(ScanFate::kWaiting).value_or(std::vector<std::string>());
}

hal::Result<std::set<std::string>> BenderDesk::SessionsInHand() const {
  const std::lock_guard lock(mutex_);
  std::set<std::string> sessions;
  for (const ScanFate fate : {ScanFate::kWaiting, ScanFate::kUnknown}) {
    const auto found = ledger_.Sessions(fate);
    if (!found) return hal::Fail(found.error());
    sessions.insert(found->begin(), found->end());
  }
  const auto unfinished = journal_.Unfinished();
  if (!unfinished) return hal::Fail(unfinished.error());
  if (*unfinished) sessions.insert((*unfinished)->session);
  return sessions;
}

hal::Result<void> BenderDesk::DropOld(double most_days) {
  const std::lock_guard lock(mutex_);
  return DropOldFromJournal(options_.journal, most_days, Now().unix_ms);
}

bool BenderDesk::SessionCommitted(const std::string& session) const {
  const std::lock_guard lock(mutex_);
  return journal_.SessionCommitted(session).value_or(false);
}

std::uint32_t BenderDesk::LastSequence() const {
  const std::lock_guard lock(mutex_);
  return journal_.LastSequence().value_or(0);
}

std::optional<CommitAttempt> BenderDesk::LastAttempt() const {
  auto last = LastEnded();
  if (last && last->step != CommitStep::kCommitted) last.reset();
  return last;
}

std::optional<CommitAttempt> BenderDesk::LastEnded() const {
  const std::lock_guard lock(mutex_);
  const auto last = journal_.Last();
  if (!last || !*last || !IsEnd((*last)->step)) return std::nullopt;
  return **last;
}

std::string BenderDesk::Locked() const {
  const std::lock_guard lock(mutex_);
  if (protocol_) return protocol_->Locked();
  const auto open = journal_.OpenBreach();
  return open && *open ? **open : "";
}

hal::Result<void> BenderDesk::Acknowledge(const std::string& who) {
  const std::lock_guard lock(mutex_);
  return protocol_ ? protocol_->Acknowledge(who) : journal_.Acknowledge(who);
}

unsigned BenderDesk::LargestPartNumber() const {
  const std::lock_guard lock(mutex_);
  return journal_.LargestPartNumber().value_or(0);
}

void BenderDesk::NoteSequence(std::uint32_t sequence) {
  const std::lock_guard lock(mutex_);
  if (sequence > journal_.LastSequence().value_or(0)) {
    static_cast<void>(journal_.NoteSequence(sequence));
  }
}

std::uint64_t CountModulus(const hal::RegisterMap& map) {
  if (!map.parts_bent) return std::uint64_t{1} << 32;
  return static_cast<std::uint64_t>(hal::RawRangeOf(map.parts_bent->type).max) + 1;
}

}  // namespace bendloop::host
