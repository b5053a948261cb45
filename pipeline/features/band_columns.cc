// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/band_columns.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "pipeline/math/arc_tangents.h"

namespace bendloop::pipeline {
namespace {

struct BandSettings {
  std::size_t columns = 48;
  // Columns that hold so many sigma more or fewer samples than the rough plane says are hidden, or
  // something lies on them; no more than this part of all.
  double odd = 6.0, most_odd = 0.25;
  // Part of the turn that must not be hidden.
  double least_seen = 0.2;
  // Samples of a cell in the test whether they are scattered, sectors of the turn in it at most,
  // and the variance of cells over their mean: 1 of scattered samples, far more of lines, less of
  // grids.
  double in_cell = 8.0;
  std::size_t sectors = 8;
  double in_sector = 120.0;
  double least_scatter = 0.6, most_scatter = 1.5;
  // The same of small cells: rings about as wide as laser lines lie apart have as many samples
  // each, and lines that lie aslant leave none but narrow columns uneven.
  double in_small_cell = 2.0, most_of_small = 1.3;
};
constexpr BandSettings kBand;

}  // namespace

BandColumns::BandColumns(std::span<const BandSample> samples, const Eigen::Vector3d& plane_mm,
                         const EndSectors& hidden, double band_mm, double deep_mm)
    : band_mm_(band_mm),
      deep_mm_(deep_mm),
      hidden_(hidden),
      deep_(kBand.columns),
      near_(kBand.columns) {
  std::vector<double> cosine, sine, around_rad(samples.size());
  cosine.reserve(samples.size()), sine.reserve(samples.size());
  for (const BandSample& sample : samples) {
    cosine.push_back(sample.cosine);
    sine.push_back(sample.sine);
  }
  ArcTangents(sine, cosine, around_rad);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const BorderSample own{{1.0, cosine[i], sine[i]}, samples[i].beyond_mm};
    const double level_mm = own.at_mm - own.row.dot(plane_mm);
    const double turn = around_rad[i] / (2.0 * std::numbers::pi);
    const double part = (turn - std::floor(turn)) * static_cast<double>(kBand.columns);
    const auto k = std::min(kBand.columns - 1, static_cast<std::size_t>(part));
    if (IsHidden(k)) continue;
    if (level_mm < -band_mm_) {
      deep_[k].push_back(-band_mm_ - level_mm);
    } else {
      near_[k].push_back(own);
    }
  }
}

bool BandColumns::AreScattered(double smear_mm) const {
  double samples = 0;
  for (std::size_t k = 0; k < kBand.columns; ++k) samples += Deep(k);
  std::size_t sectors = kBand.sectors;
  while (sectors > 1 && samples < kBand.in_sector * static_cast<double>(sectors)) {
    sectors /= 2;
  }
  const double small = kBand.in_small_cell, most = kBand.most_of_small;
  return AreScatteredIn({sectors, kBand.in_cell, 2.0 * smear_mm, kBand.most_scatter}) &&
         AreScatteredIn({sectors, small, 0.0, most}) &&
         AreScatteredIn({kBand.columns, small, 0.0, most});
}

double BandColumns::DensityDoubt() const {
  double nearer = 0, farther = 0;
  for (const auto& column : deep_) {
    for (const double below_mm : column) (below_mm < 0.5 * deep_mm_ ? nearer : farther) += 1;
  }
  const double change = std::abs(nearer - farther) / std::max(1.0, nearer + farther);
  return 2.0 * (1.0 + band_mm_ / deep_mm_) * change;
}

std::optional<std::vector<BorderSample>> BandColumns::Seen(double spread_mm,
                                                           Eigen::Vector3d& missing) const {
  std::vector<BorderSample> seen;
  std::size_t odd = 0, asked = 0;
  missing.setZero();
  const double half_rad = std::numbers::pi / static_cast<double>(kBand.columns);
  for (std::size_t k = 0; k < kBand.columns; ++k) {
    if (IsHidden(k)) continue;
    ++asked;
    const double per_mm = Deep(k) / deep_mm_;  // along the tube
    const double expected = per_mm * band_mm_;
    const double off = std::abs(static_cast<double>(near_[k].size()) - expected);
    if (Deep(k) < 1 || off > kBand.odd * std::sqrt(expected + 1.0) + per_mm * 4.0 * spread_mm) {
      ++odd;
      continue;
    }
    seen.insert(seen.end(), near_[k].begin(), near_[k].end());
    const double middle_rad = (2.0 * static_cast<double>(k) + 1.0) * half_rad;
    const double mean = std::sin(half_rad) / half_rad;  // over the column, of what is 1 there
    missing +=
        per_mm * Eigen::Vector3d(1.0, mean * std::cos(middle_rad), mean * std::sin(middle_rad));
  }
  if (static_cast<double>(odd) > kBand.most_odd * static_cast<double>(asked) ||
      static_cast<double>(asked - odd) < kBand.least_seen * static_cast<double>(kBand.columns)) {
    return std::nullopt;
  }
  return seen;
}

bool BandColumns::AreScatteredIn(const Cells& in) const {
  const std::size_t together = kBand.columns / in.sectors;
  double squares = 0, cells = 0;
  for (std::size_t sector = 0; sector < in.sectors; ++sector) {
    double all = 0;
    for (std::size_t k = 0; k < together; ++k) all += Deep(sector * together + k);
    if (all < 10.0 * in.in_cell) continue;
    double rings = std::floor(all / in.in_cell);
    if (in.least_ring_mm > 0) rings = std::floor(std::min(rings, deep_mm_ / in.least_ring_mm));
    if (rings < 4) continue;
    std::vector<double> count(static_cast<std::size_t>(rings));
    for (std::size_t k = 0; k < together; ++k) {
      for (const double below_mm : deep_[sector * together + k]) {
        const auto ring = static_cast<std::size_t>(below_mm / deep_mm_ * rings);
        count[std::min(count.size() - 1, ring)] += 1;
      }
    }
    for (const double in_ring : count) {
      squares += std::pow(in_ring - all / rings, 2) * rings / all;
    }
    cells += rings - 1;
  }
  const double scatter = squares / std::max(1.0, cells);
  const double chance = 4.0 * std::sqrt(2.0 / std::max(1.0, cells));
  // Few samples leave no small cells, which say nothing then.
  if (cells <= 20) return in.in_cell < kBand.in_cell;
  return scatter < in.most_scatter + chance && scatter > kBand.least_scatter - chance;
}

bool BandColumns::IsHidden(std::size_t k) const { return hidden_[k * kEndSectors / kBand.columns]; }

}  // namespace bendloop::pipeline
