// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include "drivers/simulated_scanner/virtual_scan.h"
#include "hal/profile_source.h"

namespace bendloop::drivers {

// A virtual scan from its start event to its end event, without waiting.
class VirtualScanSource final : public hal::ProfileSource {
 public:
  explicit VirtualScanSource(std::shared_ptr<const VirtualScan> scan) : scan_(std::move(scan)) {}

  hal::Result<hal::SourceInfo> Open() override {
    next_ = 0;
    return hal::SourceInfo{"virtual scan", "", "", false, scan_->max_points()};
  }
  hal::Result<void> Start() override { return {}; }
  hal::Result<hal::ReadStatus> Read(hal::LaserProfile& profile, hal::ScanEvent& event,
                                    std::chrono::nanoseconds) override {
    const std::size_t item = next_;
    if (item > scan_->profile_count() + 1) return hal::ReadStatus::kEnd;
    ++next_;
    if (item == 0) {
      event = scan_->StartEvent();
    } else if (item <= scan_->profile_count()) {
      scan_->Make(item - 1, profile);
      return hal::ReadStatus::kProfile;
    } else {
      event = scan_->EndEvent();
    }
    return hal::ReadStatus::kEvent;
  }
  void Stop() override {}

 private:
  std::shared_ptr<const VirtualScan> scan_;
  std::size_t next_ = 0;
};

}  // namespace bendloop::drivers
