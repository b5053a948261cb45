// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/pass_offsets.h"

#include <algorithm>
#include <cmath>

#include "pipeline/math/text.h"

namespace bendloop::pipeline {
namespace {

// [sigma] Of a normal drift one pass in 10^7 lies so far off.
constexpr double kMoved = 6.0;

}  // namespace

std::string PassBeside::Text() const {
  return "pass " + std::to_string(number) + " of the scan lies " + Fixed(moved_mm, 3) + " mm and " +
         Fixed(turned_deg, 3) + " degrees beside the others";
}

std::optional<PassBeside> FurthestPass(std::span<const PassOffset> passes, const PassDrift& drift) {
  PassOffset sum;
  double count = 0;
  for (const PassOffset& pass : passes) {
    if (pass.points == 0) continue;
    sum.move_mm += pass.move_mm;
    sum.turn_deg += pass.turn_deg;
    ++count;
  }
  if (count < 2) return std::nullopt;
  // The mean of the others drifts, too.
  const double spread = std::sqrt(count / (count - 1.0));
  PassBeside furthest;
  furthest.limit_mm = kMoved * spread * drift.move_mm;
  furthest.limit_deg = kMoved * spread * drift.turn_deg;
  double most = -1;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    if (passes[i].points == 0) continue;
    const double of_mean = count / (count - 1.0);
    const double moved_mm = of_mean * (passes[i].move_mm - sum.move_mm / count).norm();
    const double turned_deg = of_mean * (passes[i].turn_deg - sum.turn_deg / count).norm();
    const double off = std::max(moved_mm / furthest.limit_mm, turned_deg / furthest.limit_deg);
    if (!(off > most)) continue;
    most = off;
    furthest.number = i + 1;
    furthest.moved_mm = moved_mm;
    furthest.turned_deg = turned_deg;
  }
  return furthest;
}

}  // namespace bendloop::pipeline
