// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "hal/bender_link.h"

namespace bendloop::test {

// Our process dies here: unwinds out of the protocol, which has no way to know.
struct Crash {};

enum class FaultWhen : std::uint8_t { kBefore, kAfter };  // the call's effect on the bender

struct Fault {
  int at_call = -1;  // -1: never; counted over all calls of the link, from 0
  FaultWhen when = FaultWhen::kBefore;
  bool crash = false;                      // else the call returns an error
  int down_for = 0;                        // that many following calls fail, too
  std::function<void()> bender_side = {};  // what happens at the bender at this moment
};

// A link that fails, or a process that dies, at one chosen call.
class FaultyLink final : public hal::BenderLink {
 public:
  FaultyLink(hal::BenderLink& link, Fault fault) : link_(link), fault_(std::move(fault)) {}

  int calls() const { return calls_; }
  // Happens at the bender just before every call reaches it.
  std::function<void(int call)> before_call;
  // Replaces the commit: the write is lost to our sight, and arrives later or never.
  std::function<void(std::uint32_t)> swallow_commit;
  // Replaces the staging at the fault: a part of the registers arrives.
  std::function<void(const hal::ProgramBlock&)> tear_stage;

  hal::Result<hal::BenderInfo> Connect() override {
    return Call<hal::BenderInfo>([&] { return link_.Connect(); });
  }
  hal::Result<hal::BenderState> ReadState() override {
    return Call<hal::BenderState>([&] { return link_.ReadState(); });
  }
  hal::Result<hal::ProgramBlock> ReadActive() override {
    return Call<hal::ProgramBlock>([&] { return link_.ReadActive(); });
  }
  hal::Result<hal::ProgramBlock> ReadActiveAsItStands() override {
    return Call<hal::ProgramBlock>([&] { return link_.ReadActiveAsItStands(); });
  }
  hal::Result<hal::ProgramBlock> Encode(const hal::ProgramBlock& block) override {
    return link_.Encode(block);  // no exchange with the bender
  }
  hal::Result<void> Stage(const hal::ProgramBlock& block) override {
    if (tear_stage && calls_ == fault_.at_call) tear_stage(block);
    return Call<void>([&] { return link_.Stage(block); });
  }
  hal::Result<hal::ProgramBlock> ReadStaged() override {
    return Call<hal::ProgramBlock>([&] { return link_.ReadStaged(); });
  }
  hal::Result<void> Commit(std::uint32_t sequence) override {
    if (swallow_commit) {
      ++calls_;
      swallow_commit(sequence);
      return hal::Fail(hal::ErrorKind::kDevice, "injected: no answer to the commit");
    }
    return Call<void>([&] { return link_.Commit(sequence); });
  }

 private:
  template <class T, class Do>
  hal::Result<T> Call(Do perform) {
    const int call = calls_++;
    if (before_call) before_call(call);
    const auto error =
        hal::Fail(hal::ErrorKind::kDevice, "injected: link failed at call " + std::to_string(call));
    if (call > fault_.at_call && call <= fault_.at_call + fault_.down_for) return error;
    if (call != fault_.at_call) return perform();
    if (fault_.when == FaultWhen::kAfter) (void)perform();
    if (fault_.bender_side) fault_.bender_side();
    if (fault_.crash) throw Crash{};
    return error;
  }

  hal::BenderLink& link_;
  Fault fault_;
  int calls_ = 0;
};

}  // namespace bendloop::test
