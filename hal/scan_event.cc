// SPDX-License-Identifier: Apache-2.0
#include "hal/scan_event.h"

#include <algorithm>

namespace bendloop::hal {
namespace {
constexpr std::array<std::string_view, 6> kNames = {"scan_start", "scan_end", "button",
                                                    "gap",        "fault",    "other"};
}

std::string_view Name(ScanEventKind kind) { return kNames[static_cast<std::size_t>(kind)]; }

ScanEventKind ScanEventKindFromName(std::string_view name) {
  const auto* found = std::find(kNames.begin(), kNames.end(), name);
  return found == kNames.end() ? ScanEventKind::kOther
                               : static_cast<ScanEventKind>(found - kNames.begin());
}

void ScanEvent::set_detail(std::string_view text) {
  detail_size_ = static_cast<std::uint8_t>(std::min(text.size(), detail_.size()));
  std::copy_n(text.data(), detail_size_, detail_.data());
}

}  // namespace bendloop::hal
