// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_burr.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "pipeline/features/end_sectors.h"

namespace bendloop::pipeline {
namespace {

struct BurrSettings {
  // [sigma] and [of r_P] How far a burr stands out at least; and at most.
  double out_sigmas = 5.0, out = 0.01, most_out = 0.2;
  double tip_sigmas = 2.0;   // [sigma] so much nearer a cloud's tip may lie; by trial
  double face_sigmas = 3.0;  // so near to it the face of the cut is seen, where anything inside is
  // [of r_P] How long one may be along the tube; lengths are tried from a part of it on.
  double longest_burr = 0.3, lengths = 32;
  // How it rises to its tip, as powers of how far along it is: evenly, or the more the nearer.
  std::array<double, 4> rises = {1.0, 1.5, 2.0, 3.0};
  // Samples that stand out, and how many times as many as in the next as long piece of the wall.
  double least_out = 12.0, times = 4.0;
  // [of r_P] and [of those that stand out] What goes on so far beyond the end is none of it.
  double beyond = 0.06, least_beyond = 0.2;
  // Samples of a sector that tell how far it stands out there, and by how many sigma.
  double least_of_sector = 6.0, certain = 5.0;
  // [of the turn], [of its mean height] and [of r_P] What is so much of the turn, differs by no
  // more than that around it, and is higher, was made: a tool tears no burr as evenly.
  double made_all = 0.9, made_even = 0.15, made_out = 0.08;
};
constexpr BurrSettings kBurr;

// How far [mm] a sample stands out at least that may be a burr's.
double LeastOutMm(double r_mm, double noise_mm) {
  return std::max(kBurr.out_sigmas * noise_mm, kBurr.out * r_mm);
}

struct BurrSample {
  std::size_t sector;
  double before_mm, off_mm;
};

// How far each sector stands out at the border, if the burr is `length_mm` long and rises with this
// power of the way along it: least squares.
struct BurrSums {
  std::array<double, kEndSectors> n{}, square{}, product{};
  double explained = 0;  // of the sum of squares
  double length_mm = 0, rise = 1;

  void Add(const BurrSample& sample) {
    const double along = std::max(0.0, 1.0 - sample.before_mm / length_mm);
    const double part = rise == 1.0 ? along : std::pow(along, rise);
    const std::size_t sector = sample.sector;
    n[sector] += part > 0 ? 1 : 0;
    square[sector] += part * part;
    product[sector] += part * sample.off_mm;
  }
  void Sum() {
    for (std::size_t i = 0; i < kEndSectors; ++i) {
      if (product[i] > 0) explained += product[i] * product[i] / square[i];
    }
  }
};

// How high a burr stands out at the border of a sector, and how much higher it would be for each mm
// that the border lay further out.
struct BurrHeight {
  std::size_t sector = 0;
  double mm = 0, sigma_mm = 0, per_mm = 0;
};
// Over all lengths and rises that it may have, as likely as they explain the samples. Nothing: too
// few tell.
BurrHeight HeightOf(std::span<const BurrSums> fits, std::size_t sector, double noise_mm) {
  double most = 0;
  for (const BurrSums& fit : fits) most = std::max(most, fit.explained);
  double all = 0, mean = 0, square = 0, per_mm = 0;
  for (const BurrSums& fit : fits) {
    if (fit.n[sector] < kBurr.least_of_sector) continue;
    const double odds = std::exp(0.5 * (fit.explained - most) / (noise_mm * noise_mm));
    const double height_mm = fit.product[sector] / fit.square[sector];
    all += odds;
    mean += odds * height_mm;
    square += odds * (height_mm * height_mm + noise_mm * noise_mm / fit.square[sector]);
    per_mm += odds * fit.rise * height_mm / fit.length_mm;
  }
  if (!(all > 0)) return {};
  mean /= all;
  return {sector, mean, std::sqrt(std::max(0.0, square / all - mean * mean)), per_mm / all};
}

// What heights have in common: their mean, by how much they differ beyond their sigmas, and the
// mean square of these.
struct BurrHeights {
  explicit BurrHeights(std::span<const BurrHeight> heights) {
    const auto n = static_cast<double>(heights.size());
    double spread2 = 0;
    for (const BurrHeight& height : heights) mean_mm += height.mm / n;
    for (const BurrHeight& height : heights) {
      spread2 += std::pow(height.mm - mean_mm, 2) / std::max(1.0, n - 1.0);
      known2 += height.sigma_mm * height.sigma_mm / n;
    }
    differ2 = std::max(0.0, spread2 - known2);
  }
  double mean_mm = 0, differ2 = 0, known2 = 0;
};

// The highest of some. By chance one of many is told too high: as far from their mean as they
// differ by more than their sigmas say (Efron and Morris 1973).
BurrHeight HighestOf(std::span<const BurrHeight> heights, const BurrHeights& all) {
  const auto n = static_cast<double>(heights.size());
  const auto& [mean_mm, differ2, known2] = all;
  BurrHeight highest;
  for (BurrHeight height : heights) {
    const double sigma2 = height.sigma_mm * height.sigma_mm;
    const double own = n > 1 ? differ2 / (differ2 + sigma2) : 1.0;
    height.mm = mean_mm + own * (height.mm - mean_mm);
    height.sigma_mm = std::sqrt(own * sigma2 + (1.0 - own) * (1.0 - own) * known2 / n);
    if (height.mm > highest.mm) highest = height;
  }
  return highest;
}

// Whether a tool made what stands out on this part of the turn, and tore no burr.
bool IsMade(const BurrHeights& all, double part, double r_mm) {
  return part > kBurr.made_all && all.mean_mm > kBurr.made_out * r_mm &&
         std::sqrt(all.differ2) < kBurr.made_even * all.mean_mm;
}

}  // namespace

std::vector<NearEnd> StandingOut(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm,
                                 double r_mm, double noise_mm) {
  const double least_mm = LeastOutMm(r_mm, noise_mm);
  const double longest_mm = kBurr.longest_burr * r_mm;
  std::vector<NearEnd> out;
  double before = 0;
  for (const NearEnd& sample : near.outside()) {
    const double before_mm = -sample.BeyondMm(plane_mm), off_mm = sample.RadiusMm() - r_mm;
    if (before_mm < -longest_mm || before_mm > 2.0 * longest_mm) continue;
    if (off_mm > kBurr.most_out * r_mm) continue;
    if (before_mm < longest_mm) {
      out.push_back(sample);
    } else if (off_mm > least_mm) {
      before += 1;
    }
  }
  const auto count = static_cast<double>(out.size());
  if (count < kBurr.least_out || count < kBurr.times * before) out.clear();
  return out;
}

std::optional<EndRim> FindRim(const SamplesNearEnd& near, const RimTip& tip, double r_mm,
                              double noise_mm) {
  const double least_mm = LeastOutMm(r_mm, noise_mm);
  const double longest_mm = kBurr.longest_burr * r_mm;
  const double face_mm = near.inside().empty() ? 0.0 : kBurr.face_sigmas * noise_mm;
  std::vector<BurrSample> samples;
  double out = 0, beyond = 0;
  for (const NearEnd& sample : near.wall()) {
    const double before_mm = -sample.BeyondMm(tip.plane_mm), off_mm = sample.RadiusMm() - r_mm;
    if (std::abs(before_mm) > longest_mm || off_mm > kBurr.most_out * r_mm) continue;
    if (off_mm > least_mm) (before_mm < -kBurr.beyond * r_mm ? beyond : out) += 1;
    if (before_mm < face_mm) continue;
    samples.push_back({EndSectorOf(sample.AroundRad()), before_mm, off_mm});
  }
  if (out < kBurr.least_out || beyond > kBurr.least_beyond * out) return std::nullopt;
  std::vector<BurrSums> fits;
  for (double i = 1; i <= kBurr.lengths; ++i) {
    for (const double rise : kBurr.rises) {
      BurrSums& sums = fits.emplace_back();
      sums.length_mm = longest_mm * i / kBurr.lengths;
      sums.rise = rise;
      for (const BurrSample& sample : samples) sums.Add(sample);
      sums.Sum();
    }
  }
  std::vector<BurrHeight> heights;
  for (std::size_t i = 0; i < kEndSectors; ++i) {
    BurrHeight height = HeightOf(fits, i, noise_mm);
    if (height.mm < std::max(kBurr.certain * height.sigma_mm, kBurr.out * r_mm)) continue;
    height.sigma_mm = std::hypot(height.sigma_mm, height.per_mm * r_mm * tip.slope_sigma);
    heights.push_back(height);
  }
  // What stands out further at the end is a flare, of which only the flatter samples were asked.
  // Where nobody knows the passes of laser lines the tip may lie nearer than it was found.
  const double nearer_mm = near.knows_passes() ? 0.0 : kBurr.tip_sigmas * tip.at_sigma_mm;
  const bool is_high = std::any_of(heights.begin(), heights.end(), [&](const BurrHeight& height) {
    return height.mm - height.per_mm * nearer_mm > kBurr.most_out * r_mm;
  });
  if (heights.empty() || is_high) return std::nullopt;
  const BurrHeights all(heights);
  const double part = static_cast<double>(heights.size()) / static_cast<double>(kEndSectors);
  if (IsMade(all, part, r_mm)) return EndRim{};
  const BurrHeight highest = HighestOf(heights, all);
  BurrFound burr;
  burr.height_mm = highest.mm;
  burr.sigma_mm = std::hypot(highest.sigma_mm, highest.per_mm * tip.at_sigma_mm);
  const double turn =
      (static_cast<double>(highest.sector) + 0.5) / static_cast<double>(kEndSectors);
  burr.around_deg = std::remainder(360.0 * turn, 360);
  burr.part = part;
  return EndRim{burr};
}

}  // namespace bendloop::pipeline
