// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cell/bender_desk.h"

#include <algorithm>
#include <utility>

#include "drivers/register_bender/register_bender.h"
#include "drivers/simulated_bender/simulated_bender.h"
#include "firmware-host/cell/bender_carrier.h"
#include "firmware-host/ledger/journal_retention.h"
#include "hal/scope_exit.h"

namespace bendloop::host {
namespace {

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
  auto ledger = TubeLedger::Open(options.journal, options.ledger);
  if (!ledger) return hal::Fail(ledger.error());
  return std::unique_ptr<BenderDesk>(
      new BenderDesk(std::move(*journal), std::move(*ledger), options));
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
  if (KeepSettled()) now = Read();
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
  if (is_open_) KeepSettled();
  // What is thrown in the middle, for want of memory, leaves an attempt that the next look settles,
  // as after a crash; and what is thrown at the end, one whose end the next look tells.
  untold_ = request.session;
  const bool was_open = std::exchange(is_open_, true);
  commits_ = true;
  const hal::ScopeExit over([this] { commits_ = false; });
  CommitReport report = protocol_->Commit(request);
  const bool is_known = report.outcome != CommitOutcome::kUnknown;
  // The journal may not have taken the end, for want of memory or disk: the next look ends it
  // there.
  const auto left = journal_.Unfinished();
  const bool is_left = !left || *left;
  if (!is_known) told_.clear();
  if (is_known && is_left && !was_open) told_ = request.session;
  is_open_ = !is_known || is_left || was_open;
  untold_.clear();
  return report;
}

// Ends what is open; empty when nothing is, when it cannot be told yet, or was told. Where it
// throws for want of memory the next call tells.
std::optional<SettledCommit> BenderDesk::Settle() {
  if (const auto open = journal_.Unfinished(); open && *open) untold_ = (*open)->session;
  SettledCommit settled;
  const auto report = protocol_->Resume(&settled.session);
  if (report && report->outcome == CommitOutcome::kUnknown) return std::nullopt;
  if (report) {
    settled.report = *report;
  } else {
    // The journal may have an end that nobody was told.
    const auto last = journal_.Last();
    if (!last) return std::nullopt;
    if (untold_.empty() || !*last || (*last)->session != untold_) {
      is_open_ = false;
      told_.clear();
      untold_.clear();
      return std::nullopt;
    }
    settled = {untold_, EndOf(**last)};
  }
  const bool is_active = settled.report.outcome == CommitOutcome::kCommitted;
  static_cast<void>(ledger_.Note(
      settled.session, is_active ? ScanFate::kCorrected : ScanFate::kDone, settled.report.reason));
  const auto left = journal_.Unfinished();
  is_open_ = !left || *left;
  const bool was_told = settled.session == told_;
  told_ = is_open_ ? std::move(untold_) : std::string();
  untold_.clear();
  if (was_told) return std::nullopt;
  return settled;
}

// The same, for TakeSettled. Its room is taken before: there is no second time to tell it.
bool BenderDesk::KeepSettled() {
  std::list<SettledCommit> room(1);
  auto settled = Settle();
  if (!settled) return false;
  room.front() = std::move(*settled);
  settled_.splice(settled_.end(), room);
  return true;
}

std::optional<SettledCommit> BenderDesk::Resume() {
  const std::lock_guard lock(mutex_);
  return protocol_ && !options_.read_only ? Settle() : std::nullopt;
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
  const auto is_ended = [](CommitStep step) {
    return step == CommitStep::kCommitted || step == CommitStep::kNotCommitted;
  };
  if (!last || !*last || !is_ended((*last)->step)) return std::nullopt;
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
