// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <string>

#include "firmware-host/commit/commit_protocol.h"

namespace bendloop::host {
namespace {

std::string Differs(const std::string& what, double found, double expected) {
  char text[160];
  std::snprintf(text, sizeof text, "%s is %.10g, expected %.10g", what.c_str(), found, expected);
  return text;
}

}  // namespace

std::string Describe(const hal::ProgramBlock& block) {
  char text[96];
  std::snprintf(text, sizeof text, "part %u, sequence %u, %zu rows, crc 0x%08x", block.part_number,
                block.sequence, block.program.rows.size(), block.crc);
  return text;
}

std::string FirstDifference(const hal::ProgramBlock& found, const hal::ProgramBlock& expected) {
  if (found.part_number != expected.part_number) {
    return Differs("part number", found.part_number, expected.part_number);
  }
  if (found.sequence != expected.sequence) {
    return Differs("sequence", found.sequence, expected.sequence);
  }
  const auto& a = found.program.rows;
  const auto& b = expected.program.rows;
  if (a.size() != b.size()) {
    return Differs("row count", static_cast<double>(a.size()), static_cast<double>(b.size()));
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::string row = "row " + std::to_string(i + 1);
    if (a[i].length_mm != b[i].length_mm) {
      return Differs(row + " length_mm", a[i].length_mm, b[i].length_mm);
    }
    if (a[i].rotation_deg != b[i].rotation_deg) {
      return Differs(row + " rotation_deg", a[i].rotation_deg, b[i].rotation_deg);
    }
    if (a[i].angle_deg != b[i].angle_deg) {
      return Differs(row + " angle_deg", a[i].angle_deg, b[i].angle_deg);
    }
    if (a[i].bend_radius_mm != b[i].bend_radius_mm) {
      return Differs(row + " bend_radius_mm", a[i].bend_radius_mm.value_or(0),
                     b[i].bend_radius_mm.value_or(0));
    }
  }
  return found.crc == expected.crc ? "" : Differs("crc", found.crc, expected.crc);
}

std::uint32_t NextSequenceNumber(std::initializer_list<std::uint32_t> used, std::uint32_t max) {
  std::uint32_t next = 0;
  for (std::uint32_t number : used) next = number > next ? number : next;
  const auto is_used = [&used](std::uint32_t number) {
    for (std::uint32_t other : used) {
      if (other == number) return true;
    }
    return false;
  };
  do {
    next = next >= max ? 1 : next + 1;
  } while (is_used(next) && max > used.size());
  return next;
}

const char* Name(CommitOutcome outcome) {
  switch (outcome) {
    case CommitOutcome::kCommitted:
      return "committed";
    case CommitOutcome::kRefused:
      return "refused";
    case CommitOutcome::kFailed:
      return "failed";
    case CommitOutcome::kWaiting:
      return "waiting";
    case CommitOutcome::kUnknown:
      return "unknown";
  }
  return "unknown";
}

}  // namespace bendloop::host
