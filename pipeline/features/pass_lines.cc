// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/pass_lines.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct PassLineSettings {
  // [of the gap] A line is found again no further from where the strips before have it; and in so
  // many strips further on.
  double same = 0.35;
  std::size_t strips_on = 3;
  // Strips that have two lines, by which these tell of pace and tilt; and so many pairs.
  std::size_t least_common = 6, least_pairs = 3;
  // [of the gap] No pace and no tilt is known to be more even; nor is one step known better.
  double least_scatter = 0.01, least_step = 0.003;
  // [of the gap] A line that is known as well as this is one of its own in each strip.
  double own = 0.05;
};
constexpr PassLineSettings kPassLines;

}  // namespace

PassLines::PassLines(std::vector<std::vector<StripCrossing>> strips) : strips_(std::move(strips)) {
  double crossings = 0;
  std::vector<double> gaps_mm;
  for (const auto& strip : strips_) {
    for (std::size_t i = 0; i < strip.size(); ++i) {
      middle_ += strip[i].direction;
      crossings += 1;
      if (i > 0) gaps_mm.push_back(strip[i].at_mm - strip[i - 1].at_mm);
    }
  }
  if (gaps_mm.empty()) return;
  middle_ /= crossings;
  gap_mm_ = Median(std::move(gaps_mm));
  Link();
  FindNext();
  FindSteps();
  LearnSteps();
}

void PassLines::Link() {
  struct Followed {
    double at_mm = 0, slope_mm = 0;  // where last, and by how much further a strip
    std::size_t strip = 0;
  };
  std::vector<Followed> lines;
  line_of_.resize(strips_.size());
  for (std::size_t s = 0; s < strips_.size(); ++s) {
    const auto& strip = strips_[s];
    line_of_[s].assign(strip.size(), kNone);
    std::vector<bool> is_taken(lines.size(), false);
    for (std::size_t i = 0; i < strip.size(); ++i) {
      std::size_t best = kNone;
      double least_mm = kPassLines.same * gap_mm_;
      for (std::size_t k = 0; k < is_taken.size(); ++k) {
        const auto on = static_cast<double>(s - lines[k].strip);
        if (is_taken[k] || s - lines[k].strip > kPassLines.strips_on) continue;
        const double off_mm = std::abs(strip[i].at_mm - lines[k].at_mm - on * lines[k].slope_mm);
        if (off_mm >= least_mm) continue;
        least_mm = off_mm;
        best = k;
      }
      if (best == kNone) {
        best = lines.size();
        lines.push_back({strip[i].at_mm, 0.0, s});
        extents_.push_back({s, s, 0});
      } else {
        is_taken[best] = true;
        Followed& line = lines[best];
        const double slope_mm = (strip[i].at_mm - line.at_mm) / static_cast<double>(s - line.strip);
        line = {strip[i].at_mm, 0.5 * (line.slope_mm + slope_mm), s};
      }
      line_of_[s][i] = best;
      extents_[best].last = s;
      ++extents_[best].strips;
    }
  }
  double crossed = 0, within = 0;
  for (const Extent& extent : extents_) {
    crossed += static_cast<double>(extent.strips);
    within += static_cast<double>(extent.last - extent.first + 1);
  }
  lost_part_ = 1.0 - crossed / std::max(1.0, within);
}

void PassLines::FindNext() {
  // The line after each is the one that most strips have behind it.
  std::vector<std::vector<std::size_t>> behind(extents_.size());
  for (const auto& of_strip : line_of_) {
    for (std::size_t i = 0; i + 1 < of_strip.size(); ++i) {
      behind[of_strip[i]].push_back(of_strip[i + 1]);
    }
  }
  for (std::vector<std::size_t>& votes : behind) {
    std::size_t next = kNone, most = 0;
    std::sort(votes.begin(), votes.end());
    for (std::size_t i = 0; i < votes.size();) {
      std::size_t end = i;
      while (end < votes.size() && votes[end] == votes[i]) ++end;
      if (end - i > most) {
        most = end - i;
        next = votes[i];
      }
      i = end;
    }
    next_of_.push_back(next);
  }
}

Eigen::Vector3d PassLines::RowOf(const StripCrossing& crossing) const {
  const Eigen::Vector2d off = crossing.direction - middle_;
  return {1.0, off.x(), off.y()};
}

void PassLines::FindSteps() {
  steps_.resize(next_of_.size());
  for (std::size_t s = 0; s < strips_.size(); ++s) {
    for (std::size_t i = 0; i + 1 < strips_[s].size(); ++i) {
      const std::size_t line = line_of_[s][i];
      if (line_of_[s][i + 1] != next_of_[line]) continue;
      const StripCrossing &from = strips_[s][i], &to = strips_[s][i + 1];
      steps_[line].push_back({to.at_mm - from.at_mm,
                              from.sigma_mm * from.sigma_mm + to.sigma_mm * to.sigma_mm,
                              RowOf(to)});
    }
  }
}

void PassLines::LearnSteps() {
  std::vector<double> gaps_mm;
  double tilt_mm2 = 0;
  for (const std::vector<Step>& steps : steps_) {
    if (steps.size() < kPassLines.least_common) continue;
    // A narrow view leaves tilts to the prior, and to the gap what it is there.
    Eigen::Matrix3d matrix = Eigen::Vector3d(0.0, 1e-2, 1e-2).asDiagonal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Step& step : steps) {
      matrix += step.row * step.row.transpose();
      right += step.apart_mm * step.row;
    }
    const Eigen::Vector3d fit = matrix.ldlt().solve(right);
    gaps_mm.push_back(fit[0]);
    tilt_mm2 += 0.5 * fit.tail<2>().squaredNorm();
  }
  const auto pairs = static_cast<double>(gaps_mm.size());
  if (gaps_mm.size() < kPassLines.least_pairs) {
    gap_mm_ = 0;
    return;
  }
  // About the median, of a few: one that was lost leaves a gap twice as wide.
  gap_mm_ = Median(gaps_mm);
  double square = 0;
  for (const double gap_mm : gaps_mm) {
    square += std::pow(std::min(std::abs(gap_mm - gap_mm_), 0.5 * gap_mm_), 2);
  }
  const double least_mm = kPassLines.least_scatter * gap_mm_;
  gap_sigma_mm_ = std::max(least_mm, std::sqrt(square / (pairs - 1.0) * (1.0 + 1.0 / pairs)));
  tilt_sigma_mm_ = std::max(least_mm, std::sqrt(tilt_mm2 / pairs));
}

bool PassLines::HasLostNext(std::size_t strip) const {
  if (strips_[strip].empty()) return false;
  const std::size_t next = next_of_[line_of_[strip].back()];
  return next != kNone && extents_[next].first < strip && strip < extents_[next].last;
}

std::optional<NextLine> PassLines::After(std::size_t strip) const {
  if (!(gap_mm_ > 0) || strips_[strip].empty()) return std::nullopt;
  const StripCrossing& last = strips_[strip].back();
  const Eigen::Vector3d row = RowOf(last);
  const Eigen::Vector3d prior(gap_sigma_mm_, tilt_sigma_mm_, tilt_sigma_mm_);
  // What is known of the step to the line that follows: as others are, and what strips show of it.
  Eigen::Matrix3d certainty = prior.cwiseAbs2().cwiseInverse().asDiagonal();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  const double least_mm2 = std::pow(kPassLines.least_step * gap_mm_, 2);
  for (const Step& step : steps_[line_of_[strip].back()]) {
    const double certain = 1.0 / std::max(least_mm2, step.variance_mm2);
    certainty += certain * step.row * step.row.transpose();
    right += certain * (step.apart_mm - gap_mm_) * step.row;
  }
  const Eigen::Matrix3d covariance = certainty.inverse();
  const double variance_mm2 = row.dot(covariance * row);
  NextLine next;
  next.at_mm = last.at_mm + gap_mm_ + row.dot(covariance * right);
  next.sigma_mm = std::sqrt(variance_mm2 + last.sigma_mm * last.sigma_mm);
  next.is_shared = variance_mm2 > std::pow(kPassLines.own * gap_mm_, 2);
  return next;
}

}  // namespace bendloop::pipeline
