// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace bendloop::hal {

enum class ScanEventKind : std::uint8_t { kScanStart, kScanEnd, kButton, kGap, kFault, kOther };

// "scan_start", "scan_end", "button", "gap", "fault", "other": the words of the session file.
std::string_view Name(ScanEventKind kind);
ScanEventKind ScanEventKindFromName(std::string_view name);  // unknown words are kOther

// Something the scanner says between profiles. The detail has a fixed size so that the acquisition
// path does not allocate; longer texts are cut.
class ScanEvent {
 public:
  ScanEventKind kind = ScanEventKind::kOther;
  std::int64_t t_ns = 0;  // on the scanner's clock

  std::string_view detail() const { return {detail_.data(), detail_size_}; }
  void set_detail(std::string_view text);

 private:
  std::array<char, 119> detail_{};
  std::uint8_t detail_size_ = 0;
};

}  // namespace bendloop::hal
