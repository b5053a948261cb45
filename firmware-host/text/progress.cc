// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/progress.h"

#include <algorithm>
#include <cmath>

#include "firmware-host/text/table.h"

namespace bendloop::host {
namespace {

// A bend is whole when the straight after it has begun; the one at the scan's front still grows.
std::size_t WholeBends(const pipeline::LiveView& view) {
  const std::size_t bends = view.program.bend_count();
  if (bends == 0) return 0;
  const bool grows = view.program.rows.back().length_mm < 2.0 * view.pipe_radius_mm;
  return grows ? bends - 1 : bends;
}

}  // namespace

std::string ProgressText(const pipeline::LiveView& view, std::optional<double> expected_mm) {
  std::string text;
  const std::size_t bends = WholeBends(view);
  if (bends == 0) {
    text = view.spine_samples == 0 ? "waiting for the tube" : "first straight seen";
  } else {
    text = "bend " + std::to_string(bends) + " seen, " +
           Fixed(view.program.rows[bends - 1].angle_deg, 1);
    if (bends <= view.sigma.rows.size() && std::isfinite(view.sigma.rows[bends - 1].angle_deg)) {
      // Never "+- 0.0": an uncertainty is not nothing.
      text += " +- " + Fixed(std::max(view.sigma.rows[bends - 1].angle_deg, 0.1), 1);
    }
    text += " deg";
  }
  if (expected_mm && *expected_mm > 0) {
    const double missing_mm = std::clamp(*expected_mm - view.covered_mm, 0.0, *expected_mm);
    // The ends are seen to a pipe radius or so: less is not missing.
    if (missing_mm < 2 * view.pipe_radius_mm) {
      text += "; " + Fixed(*expected_mm, 0) + " mm of " + Fixed(*expected_mm, 0) + " seen";
    } else {
      text += "; " + Fixed(missing_mm, 0) + " mm of " + Fixed(*expected_mm, 0) + " still missing";
    }
  } else {
    text += "; " + Fixed(view.covered_mm, 0) + " mm seen";
  }
  return text;
}

void Progress::Show(const pipeline::LiveView& view, std::optional<double> expected_mm) {
  const std::string text = ProgressText(view, expected_mm);
  if (terminal_) {
    if (text == shown_) return;
    shown_ = text;
    const std::size_t most = columns_ > 4 ? columns_ - 3 : 1;
    // Back to the start of the line, the text, and clear what the longer one before it left.
    out_ << "\r  " << text.substr(0, most) << "\x1b[K" << std::flush;
    return;
  }
  const std::size_t bends = WholeBends(view);
  const double part =
      expected_mm && *expected_mm > 0 ? std::clamp(view.covered_mm / *expected_mm, 0.0, 1.0) : 0;
  const int quarters = static_cast<int>(4 * part);
  if (bends <= bends_ && quarters <= quarters_) return;
  bends_ = std::max(bends, bends_);
  quarters_ = std::max(quarters, quarters_);
  out_ << "  " << text << "\n" << std::flush;
}

void Progress::End() {
  if (terminal_ && !shown_.empty()) out_ << "\n" << std::flush;
  shown_.clear();
  bends_ = 0;
  quarters_ = -1;
}

}  // namespace bendloop::host
