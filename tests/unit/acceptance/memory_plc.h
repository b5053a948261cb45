// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/register_bender/program_codec.h"
#include "drivers/register_bender/register_bender.h"
#include "drivers/simulated_bender/bender_memory.h"
#include "firmware-host/acceptance/hand_steps.h"
#include "hal/clock.h"

namespace bendloop::test {

// The simulated PLC without a network, on a clock that moves a little with each exchange, so that
// what a mutant puts off comes when it is due. It is also who stands at it.
class MemoryPlc final : public host::HandSteps {
 public:
  MemoryPlc(const hal::RegisterMap& map, const hal::ProgramBlock& active) : memory_(map) {
    (void)memory_.LoadActive(active);
  }

  drivers::BenderMemory& memory() { return memory_; }
  hal::ManualClock& clock() { return clock_; }
  // After each such number of exchanges this machine does nothing for so long, and the PLC goes on.
  void Stall(std::size_t each, std::chrono::nanoseconds by) {
    stalls_each_ = each;
    stalls_by_ = by;
  }
  // From the exchange with this number on nothing arrives any more.
  void CutAfterWrites(std::size_t writes) { writes_left_ = writes; }
  bool is_cut() const { return cut_; }
  void Mend() {
    cut_ = false;
    writes_left_ = ~std::size_t{0};
  }
  std::size_t writes() const { return writes_; }

  bool Do(host::HandStep step) override {
    using hal::BenderMode;
    using host::HandStep;
    switch (step) {
      case HandStep::kStartCycle:
        mode_ = BenderMode::kBending;
        return true;
      case HandStep::kOpenGuard:
        mode_ = BenderMode::kNotReady;
        return true;
      case HandStep::kFault:
        mode_ = BenderMode::kFault;
        return true;
      case HandStep::kMakeIdle:
        mode_ = BenderMode::kIdle;
        return true;
      case HandStep::kPowerCycle:
        deeds_.clear();
        memory_.ClearVolatile();
        return true;
      case HandStep::kEditAtPanel:
        return memory_.EditActive(0.5).has_value();
      case HandStep::kStopProgram:
        beats_ = false;
        return true;
      case HandStep::kStartProgram:
        beats_ = true;
        return true;
    }
    return false;
  }

  std::unique_ptr<drivers::RegisterCarrier> Carrier() {
    return std::make_unique<MemoryCarrier>(*this);
  }

 private:
  class MemoryCarrier final : public drivers::RegisterCarrier {
   public:
    explicit MemoryCarrier(MemoryPlc& plc) : plc_(plc) {}
    std::string carrier() const override { return "Memory"; }
    std::string peer() const override { return "of the test"; }
    hal::Result<void> Connect() override { return {}; }
    hal::Result<void> Read(const std::vector<drivers::RegisterRange>& ranges,
                           drivers::RegisterImage& image) override {
      return plc_.Exchange(ranges, image, false);
    }
    hal::Result<void> Write(const std::vector<drivers::RegisterRange>& ranges,
                            const drivers::RegisterImage& image) override {
      return plc_.Exchange(ranges, const_cast<drivers::RegisterImage&>(image), true);
    }

   private:
    MemoryPlc& plc_;
  };

  hal::Result<void> Exchange(const std::vector<drivers::RegisterRange>& ranges,
                             drivers::RegisterImage& image, bool write) {
    constexpr std::uint16_t kMostRegisters = 120;
    for (const auto& range : drivers::PlanRequests(ranges, kMostRegisters)) {
      if (write && !cut_ && writes_left_-- == 0) cut_ = true;
      if (cut_) return hal::Fail(hal::ErrorKind::kDevice, "the line is cut");
      Tick();
      const auto address = static_cast<std::uint16_t>(range.address);
      auto* here = memory_.image().At(range.space, address);
      auto* there = image.At(range.space, address);
      if (!(write ? memory_.CanWrite(range) : memory_.CanRead(range))) {
        return hal::Fail(hal::ErrorKind::kDevice,
                         "illegal data address " + std::to_string(range.address));
      }
      if (write) {
        ++writes_;
        std::copy_n(there, range.count, here);
        if (memory_.AfterWrite(range)) memory_.HandleCommit(0);
      } else {
        std::copy_n(here, range.count, there);
      }
      if (stalls_each_ > 0 && ++exchanges_ % stalls_each_ == 0) {
        Plan();
        clock_.Advance(stalls_by_);
      }
    }
    return {};
  }

  // What the memory puts off is due from now on.
  void Plan() {
    for (auto& later : memory_.TakeLater()) {
      deeds_.emplace_back(clock_.Now() + later.after, std::move(later.deed));
    }
  }

  void Tick() {
    clock_.Advance(std::chrono::microseconds(100));
    if (beats_)
      heartbeat_ = static_cast<std::uint32_t>(clock_.Now() / std::chrono::milliseconds(10));
    memory_.SetState({.mode = mode_, .heartbeat = heartbeat_});
    Plan();
    for (std::size_t i = 0; i < deeds_.size();) {
      if (deeds_[i].first > clock_.Now()) {
        ++i;
        continue;
      }
      const auto deed = std::move(deeds_[i].second);
      deeds_.erase(deeds_.begin() + static_cast<std::ptrdiff_t>(i));
      deed(memory_);
    }
  }

  drivers::BenderMemory memory_;
  hal::ManualClock clock_;
  hal::BenderMode mode_ = hal::BenderMode::kIdle;
  std::vector<std::pair<std::chrono::nanoseconds, std::function<void(drivers::BenderMemory&)>>>
      deeds_;
  std::uint32_t heartbeat_ = 0;
  bool beats_ = true;
  bool cut_ = false;
  std::size_t writes_left_ = ~std::size_t{0};
  std::size_t writes_ = 0;
  std::size_t exchanges_ = 0;
  std::size_t stalls_each_ = 0;
  std::chrono::nanoseconds stalls_by_{0};
};

}  // namespace bendloop::test
