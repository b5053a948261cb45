// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "drivers/register_bender/register_bender.h"
#include "hal/clock.h"
#include "hal/register_map.h"

namespace bendloop::host {

// Registers that went to the PLC or came from it, as the certificate shows them.
struct Frame {
  std::chrono::nanoseconds at{0};  // when it was asked, on the run's clock
  std::string text;                // "write 1000: 0000 002a 0000 000d 0002 acec 1448"
};

// A carrier that notes what goes through it since Clear(): the first frames, where something is
// written, and the last ones, where it shows what that led to.
class FrameLog final : public drivers::RegisterCarrier {
 public:
  static constexpr std::size_t kFirst = 12;
  static constexpr std::size_t kLast = 8;

  FrameLog(const hal::RegisterMap& map, std::unique_ptr<drivers::RegisterCarrier> carrier,
           hal::Clock& clock)
      : map_(map), carrier_(std::move(carrier)), clock_(clock) {}

  std::string carrier() const override { return carrier_->carrier(); }
  std::string peer() const override { return carrier_->peer(); }
  hal::Result<void> Connect() override { return carrier_->Connect(); }
  hal::Result<void> Read(const std::vector<drivers::RegisterRange>& ranges,
                         drivers::RegisterImage& image) override;
  hal::Result<void> Write(const std::vector<drivers::RegisterRange>& ranges,
                          const drivers::RegisterImage& image) override;
  Signs signs() const override { return carrier_->signs(); }

  void Clear();
  // What was left out between the first and the last is a line of its own.
  std::vector<Frame> frames() const;

 private:
  void Note(const char* verb, std::chrono::nanoseconds at,
            const std::vector<drivers::RegisterRange>& ranges, const drivers::RegisterImage& image,
            const hal::Result<void>& done);

  const hal::RegisterMap& map_;
  std::unique_ptr<drivers::RegisterCarrier> carrier_;
  hal::Clock& clock_;
  std::vector<Frame> frames_;
  std::size_t left_out_ = 0;
};

}  // namespace bendloop::host
