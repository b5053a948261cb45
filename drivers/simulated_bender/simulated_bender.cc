// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/simulated_bender.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/register_bender/program_codec.h"
#include "drivers/simulated_bender/bender_memory.h"
#include "drivers/simulated_bender/misbehaviour.h"
#include "drivers/simulated_bender/modbus_server.h"
#include "drivers/simulated_bender/tray.h"

namespace bendloop::drivers {
namespace {

using Clock = std::chrono::steady_clock;
using Answer = Misbehaviour::Answer;

constexpr std::chrono::milliseconds kIdlePoll{1000};
constexpr std::chrono::milliseconds kHeartbeatPeriod{10};
constexpr std::chrono::milliseconds kSlowHeartbeatPeriod{5000};  // of a mutant
constexpr std::uint32_t kOperatorFault = 99;

}  // namespace

class SimulatedBender::Impl {
 public:
  // One of the two carries the requests.
  Impl(SimulatedBenderOptions options, std::unique_ptr<ModbusServer> server,
       std::unique_ptr<CanopenFront> node)
      : options_(std::move(options)),
        server_(std::move(server)),
        node_(std::move(node)),
        memory_(options_.map) {}

  hal::Result<void> Begin() {
    if (auto ok = memory_.LoadActive(options_.program); !ok) return ok;
    thread_ = std::thread([this] { Run(); });
    return {};
  }

  void Stop() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    cycle_changed_.notify_all();
    Wake();
    if (thread_.joinable()) thread_.join();
  }

  std::uint16_t port() const { return server_ ? server_->port() : 0; }
  const std::string& device() const { return server_ ? server_->device() : node_->device(); }

  hal::Result<BentPart> Bend() {
    std::unique_lock lock(mutex_);
    if (Mode() != hal::BenderMode::kIdle) {
      return hal::Fail(hal::ErrorKind::kDevice, "bender is not idle: no cycle started");
    }
    auto active = memory_.Active();
    if (!active) return hal::Fail(active.error());
    if (active->program.rows.size() < 2) {
      return hal::Fail(hal::ErrorKind::kDevice, "no complete program is active: nothing to bend");
    }
    bending_ = true;
    cycle_changed_.wait_for(lock, options_.cycle, [this] { return stopped_; });
    BentPart part{
        parts_bent_ + 1, *active, BendTube(active->program, options_.physics, parts_bent_ + 1), {}};
    bending_ = false;
    if (stopped_) return hal::Fail(hal::ErrorKind::kDevice, "bender was switched off");
    if (!options_.tray.empty()) {
      auto file =
          LayOnTray(options_.tray, part.serial, options_.pipe_radius_mm, *active, part.tube);
      if (!file) return hal::Fail(file.error());
      part.file = *file;
    }
    ++parts_bent_;
    return part;
  }

  hal::ProgramBlock Active() const {
    const std::lock_guard lock(mutex_);
    return memory_.Active().value_or(hal::ProgramBlock{});
  }

  hal::ProgramBlock Staged() const {
    const std::lock_guard lock(mutex_);
    return memory_.Staged().value_or(hal::ProgramBlock{});
  }

  void Say(const hal::PlcOrders& orders) {
    const std::lock_guard lock(mutex_);
    memory_.Say(orders);
  }
  hal::CellReport Heard() const {
    const std::lock_guard lock(mutex_);
    return memory_.Heard().value_or(hal::CellReport{});
  }
  hal::Result<void> Load(const hal::ProgramBlock& block) {
    const std::lock_guard lock(mutex_);
    return memory_.LoadActive(block);
  }

  std::uint32_t accepted() const {
    const std::lock_guard lock(mutex_);
    return memory_.accepted();
  }
  std::uint32_t rejected() const {
    const std::lock_guard lock(mutex_);
    return memory_.rejected();
  }

  hal::Result<void> Misbehave(std::string_view command) {
    const std::lock_guard lock(mutex_);
    const auto parsed = ParseMisbehaviour(command, wrong_);
    if (!parsed) return hal::Fail(parsed.error());
    memory_.set_takes_report(!wrong_.refuse_report);
    memory_.Break(wrong_.broken);
    switch (parsed->event) {
      case MisbehaviourEvent::kNone:
        break;
      case MisbehaviourEvent::kReboot:
        reboot_ = true;
        memory_.ClearVolatile();
        pending_commit_.reset();
        deeds_.clear();
        started_ = Clock::now();
        ready_at_ = started_ + options_.cycle;
        break;
      case MisbehaviourEvent::kOtherProgram:
        return LoadOtherProgram();
      case MisbehaviourEvent::kEdit:
        return memory_.EditActive(parsed->angle_deg);
      case MisbehaviourEvent::kSetCount:
        parts_bent_ = parsed->count;
        break;
      case MisbehaviourEvent::kLyingRows:
        memory_.SetActiveRowCount(options_.map.max_rows + 1u);
        break;
      case MisbehaviourEvent::kMode:
        panel_mode_ = parsed->mode;
        break;
    }
    Wake();
    return {};
  }

 private:
  struct Deferred {
    Clock::time_point due;
    std::function<void()> request;
  };

  void Wake() {
    if (server_) server_->Wake();  // a node never sleeps long
  }

  hal::Result<void> LoadOtherProgram() {
    auto block = memory_.Active();
    if (!block) return hal::Fail(block.error());
    ++block->part_number;
    block->sequence = 0;
    return memory_.LoadActive(*block);
  }

  hal::BenderMode Mode() const {
    if (Clock::now() < ready_at_) return hal::BenderMode::kNotReady;
    if (panel_mode_ != hal::BenderMode::kIdle) return panel_mode_;
    return bending_ ? hal::BenderMode::kBending : hal::BenderMode::kIdle;
  }

  void ShowState() {
    hal::BenderState state;
    state.mode = Mode();
    if (state.mode == hal::BenderMode::kFault) state.fault_code = kOperatorFault;
    const auto broken = [this](RuleMutant mutant) { return wrong_.broken.Has(mutant); };
    const bool stands =
        wrong_.freeze || broken(RuleMutant::kHeartbeatStands) ||
        (state.mode == hal::BenderMode::kFault && broken(RuleMutant::kHeartbeatStopsAtFault));
    const auto period =
        broken(RuleMutant::kHeartbeatSlow) ? kSlowHeartbeatPeriod : kHeartbeatPeriod;
    if (!stands) heartbeat_ = (Clock::now() - started_) / period + 1;
    state.heartbeat = static_cast<std::uint32_t>(heartbeat_);
    state.parts_bent = parts_bent_;
    memory_.SetState(state);
  }

  void Run() {
    for (;;) {
      server_ ? PollServer() : PollNode();
      const std::lock_guard lock(mutex_);
      if (stopped_) return;
      if (std::exchange(reboot_, false)) {
        server_ ? server_->HangUpAll() : node_->Reboot();
        late_.clear();
      }
      const auto now = Clock::now();
      while (!late_.empty() && late_.front().due <= now) {
        const std::function<void()> request = std::move(late_.front().request);
        late_.erase(late_.begin());
        request();
      }
      if (pending_commit_ && *pending_commit_ <= now) {
        pending_commit_.reset();
        CommitNow();
      }
      DoDeeds(now);
    }
  }

  // What the mutants put off.
  void DoDeeds(Clock::time_point now) {
    for (BenderMemory::Later& later : memory_.TakeLater()) {
      deeds_.push_back({now + later.after, [this, deed = std::move(later.deed)] {
                          ShowState();
                          deed(memory_);
                        }});
    }
    for (std::size_t i = 0; i < deeds_.size();) {
      if (deeds_[i].due > now) {
        ++i;
        continue;
      }
      const std::function<void()> deed = std::move(deeds_[i].request);
      deeds_.erase(deeds_.begin() + static_cast<std::ptrdiff_t>(i));
      deed();
    }
  }

  void PollServer() {
    server_->Poll(UntilNextDue(), [this](const ModbusRequest& request) {
      const std::lock_guard lock(mutex_);
      if (wrong_.late.count() > 0) {
        late_.push_back({Clock::now() + wrong_.late, [this, request] { Handle(request); }});
      } else {
        Handle(request);
      }
    });
  }

  void PollNode() {
    std::unique_lock lock(mutex_);
    const std::uint32_t fault = Mode() == hal::BenderMode::kFault ? kOperatorFault : 0;
    const bool silent = wrong_.answer == Answer::kSilent;
    lock.unlock();
    node_->Poll(UntilNextDue(), fault, silent, [this](const SdoData& frame) {
      const std::lock_guard locked(mutex_);
      // A node does one thing after the other; that a transfer is given up it need not think over.
      const bool abort = frame[0] == 0x80;
      auto due = Clock::now() + (abort ? std::chrono::milliseconds(0) : wrong_.late);
      if (!late_.empty()) due = std::max(due, late_.back().due);
      late_.push_back({due, [this, frame] { node_->Handle(frame, wrong_, bender_); }});
    });
  }

  std::chrono::milliseconds UntilNextDue() const {
    const std::lock_guard lock(mutex_);
    auto due = Clock::now() + kIdlePoll;
    if (!late_.empty()) due = std::min(due, late_.front().due);
    if (pending_commit_) due = std::min(due, *pending_commit_);
    for (const Deferred& deed : deeds_) due = std::min(due, deed.due);
    const auto wait = std::chrono::ceil<std::chrono::milliseconds>(due - Clock::now());
    return std::max(wait, std::chrono::milliseconds{0});
  }

  void CommitNow() {
    ShowState();
    memory_.HandleCommit(std::exchange(wrong_.reject_code, 0));
  }

  void Handle(const ModbusRequest& request) {
    if (wrong_.answer == Answer::kSilent) return;
    if (wrong_.answer == Answer::kException) {
      server_->ReplyException(request, wrong_.exception);
      return;
    }
    if (wrong_.answer == Answer::kGarbage) {
      server_->SendRaw(request.client,
                       {0xde, 0xad, 0xbe, 0xef, 0x00, 0xff, 0x01, 0x03, 0x55, 0xaa, 0x13, 0x37});
      return;
    }
    const std::uint8_t function = request.function();
    if (function != 0x03 && function != 0x04 && !request.is_write()) {
      server_->ReplyException(request, kIllegalFunction);
      return;
    }
    const RegisterRange range = request.range();
    const std::uint32_t most =
        request.is_write() ? options_.map.max_write_registers : options_.map.max_read_registers;
    if (range.count == 0 || range.count > most) {
      server_->ReplyException(request, kIllegalValue);
      return;
    }
    if (!(request.is_write() ? memory_.CanWrite(range) : memory_.CanRead(range))) {
      server_->ReplyException(request, kIllegalAddress);
      return;
    }
    ShowState();
    Execute(request, range);
  }

  void Execute(const ModbusRequest& request, const RegisterRange& range) {
    if (!request.is_write()) return Perform(request, false);
    const bool answered = Write(range, [&](bool drop) { Perform(request, drop); });
    if (!answered) server_->HangUp(request.client);
  }

  // A write that `store` does, told whether to leave it unanswered; false: it is unanswered.
  bool Write(const RegisterRange& range, const std::function<void(bool)>& store) {
    const auto& commit = options_.map.commit;
    const bool is_commit =
        commit && range.address <= commit->address && commit->address < range.address + range.count;
    if (is_commit && std::exchange(wrong_.drop_after_stage, false)) return false;
    const bool away = is_commit && std::exchange(wrong_.away_after_commit, false);
    const bool drop = (is_commit && std::exchange(wrong_.drop_after_commit, false)) || away;
    constexpr std::uint32_t kSmall = 2;  // the half of a single value may be the same
    const bool half = !is_commit && range.count > kSmall && std::exchange(wrong_.half_write, false);
    std::vector<std::uint16_t> kept;
    std::uint16_t* tail =
        memory_.image().At(range.space, static_cast<std::uint16_t>(range.address)) +
        range.count / 2;
    if (half) kept.assign(tail, tail + (range.count - range.count / 2));

    store(drop);
    std::copy(kept.begin(), kept.end(), tail);
    if (memory_.AfterWrite(range)) {
      if (wrong_.acknowledge_late.count() > 0) {
        pending_commit_ = Clock::now() + wrong_.acknowledge_late;
      } else {
        CommitNow();
      }
    }
    if (away) wrong_.answer = Answer::kSilent;
    return !drop;
  }

  // Reads or writes the registers and answers, well or badly.
  void Perform(const ModbusRequest& request, bool unanswered) {
    ModbusRequest seen = request;
    if (wrong_.answer == Answer::kWrongUnit) ++seen.bytes[seen.header - 1];
    // On a serial line nothing numbers a transaction: an answer to another function.
    if (wrong_.answer == Answer::kWrongTransaction) ++seen.bytes[1];
    if (wrong_.answer == Answer::kMute || wrong_.answer == Answer::kShort || unanswered) {
      seen.client = 0;
    }
    server_->Execute(seen, memory_.image());
    if (wrong_.answer == Answer::kShort) {
      server_->SendRaw(request.client, {request.bytes.begin(), request.bytes.begin() + 5});
    }
  }

  const SimulatedBenderOptions options_;
  std::unique_ptr<ModbusServer> server_;
  std::unique_ptr<CanopenFront> node_;
  const CanopenFront::Bender bender_{
      [this]() -> RegisterImage& {
        ShowState();
        return memory_.image();
      },
      [this](const RegisterRange& range, const std::function<void()>& store) {
        return Write(range, [&store](bool) { store(); });
      }};
  std::thread thread_;

  mutable std::mutex mutex_;  // of all below
  std::condition_variable cycle_changed_;
  BenderMemory memory_;
  Misbehaviour wrong_;
  std::vector<Deferred> late_;
  std::vector<Deferred> deeds_;
  std::optional<Clock::time_point> pending_commit_;
  Clock::time_point started_ = Clock::now();
  Clock::time_point ready_at_ = started_;
  std::int64_t heartbeat_ = 0;
  std::uint32_t parts_bent_ = 0;
  hal::BenderMode panel_mode_ = hal::BenderMode::kIdle;
  bool bending_ = false;
  bool reboot_ = false;
  bool stopped_ = false;
};

hal::Result<std::unique_ptr<SimulatedBender>> SimulatedBender::Start(
    SimulatedBenderOptions options) {
  if (auto ok = CheckRegisterMap(options.map); !ok) return hal::Fail(ok.error());
  if (auto ok = CheckBendingPhysics(options.physics); !ok) return hal::Fail(ok.error());
  for (const hal::BendRow& row : options.program.program.rows) {
    // A map without a radius register: the tool is the one that the first program names.
    if (options.physics.default_bend_radius_mm == 0 && row.bend_radius_mm) {
      options.physics.default_bend_radius_mm = *row.bend_radius_mm;
    }
  }
  if (options.canopen) {
    auto node = CanopenFront::Open(*options.canopen, options.map);
    if (!node) return hal::Fail(node.error());
    return Begin(std::make_unique<Impl>(std::move(options), nullptr, std::move(*node)));
  }
  auto server = options.can   ? ModbusServer::OpenCan(*options.can)
                : options.rtu ? ModbusServer::OpenLine(options.unit_id)
                              : ModbusServer::Listen(options.port);
  if (!server) return hal::Fail(server.error());
  return Begin(std::make_unique<Impl>(std::move(options), std::move(*server), nullptr));
}

hal::Result<std::unique_ptr<SimulatedBender>> SimulatedBender::Begin(std::unique_ptr<Impl> impl) {
  if (auto ok = impl->Begin(); !ok) return hal::Fail(ok.error());
  return std::unique_ptr<SimulatedBender>(new SimulatedBender(std::move(impl)));
}

SimulatedBender::SimulatedBender(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
SimulatedBender::~SimulatedBender() { Stop(); }

std::uint16_t SimulatedBender::port() const { return impl_->port(); }
const std::string& SimulatedBender::device() const { return impl_->device(); }
void SimulatedBender::Stop() { impl_->Stop(); }
hal::Result<BentPart> SimulatedBender::Bend() { return impl_->Bend(); }
hal::ProgramBlock SimulatedBender::Active() const { return impl_->Active(); }
hal::ProgramBlock SimulatedBender::Staged() const { return impl_->Staged(); }
void SimulatedBender::Say(const hal::PlcOrders& orders) { impl_->Say(orders); }
hal::CellReport SimulatedBender::Heard() const { return impl_->Heard(); }
hal::Result<void> SimulatedBender::Load(const hal::ProgramBlock& block) {
  return impl_->Load(block);
}
std::uint32_t SimulatedBender::commits_accepted() const { return impl_->accepted(); }
std::uint32_t SimulatedBender::commits_rejected() const { return impl_->rejected(); }
hal::Result<void> SimulatedBender::Misbehave(std::string_view command) {
  return impl_->Misbehave(command);
}

}  // namespace bendloop::drivers
