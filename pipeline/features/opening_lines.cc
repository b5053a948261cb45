// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_lines.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>

#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct MissedSettings {
  // Of the length-weighted mean gap: samples nearer to each other are of one line.
  double one_crossing = 0.25;
  // Of the gap between lines: gaps are as many of it as there are, give or take this.
  double even = 0.2;
  // Of a strip's gaps: so many are even; so many, but for one, are of one line to the next.
  double least_even = 0.85, least_single = 0.9;
  // Strips of a pass, tried from the most on: as narrow as its rays lie apart, they are crossed by
  // every line. Of those with samples so many are.
  std::array<std::size_t, 8> strips = {128, 96, 64, 48, 32, 24, 16, 12};
  double least_strips = 0.7;
  std::size_t least_lines = 5;
  // Of the gap: so near to each other samples are of one line; of a strip: so near to a place its
  // rays stand.
  double same_line = 0.3, beside = 2.0;
  // Cosine of the angle to the surface normal: rays that come in flatter may return nothing.
  double least_cosine = 0.35;
  // Lines one after the other: more are not missing but end.
  double most_missing = 200;
};
constexpr MissedSettings kMissed;

using Strip = std::vector<Eigen::Vector2d>;

// Lines of a strip, each by the mean of its samples. `strip`: sorted along.
Strip LinesOf(const Strip& strip) {
  double sum = 0, sum2 = 0;
  for (std::size_t i = 1; i < strip.size(); ++i) {
    const double gap = strip[i].x() - strip[i - 1].x();
    sum += gap;
    sum2 += gap * gap;
  }
  // Holes are long gaps: the root holds their weight down.
  const auto n = static_cast<double>(std::max<std::size_t>(1, strip.size() - 1));
  const double one_line_mm =
      kMissed.one_crossing * std::sqrt(sum / n * sum2 / std::max(sum, 1e-12));
  Strip lines;
  for (std::size_t i = 0; i < strip.size();) {
    Eigen::Vector2d middle = Eigen::Vector2d::Zero();
    std::size_t end = i;
    for (; end < strip.size() && (end == i || strip[end].x() - strip[end - 1].x() < one_line_mm);
         ++end) {
      middle += strip[end];
    }
    lines.emplace_back(middle / static_cast<double>(end - i));
    i = end;
  }
  return lines;
}

// Whether the same line met the wall on both sides close by: a ray lay in the strip beside.
// `samples`: sorted along; `near_mm`: along and around.
bool IsBetweenHits(const Strip& samples, const Eigen::Vector2d& place,
                   const Eigen::Vector2d& near_mm) {
  const auto first = std::lower_bound(
      samples.begin(), samples.end(), place.x() - near_mm.x(),
      [](const Eigen::Vector2d& sample, double at_mm) { return sample.x() < at_mm; });
  bool below = false, above = false;
  for (auto at = first; at != samples.end() && at->x() < place.x() + near_mm.x(); ++at) {
    const double off_mm = at->y() - place.y();
    if (std::abs(off_mm) > near_mm.y()) continue;
    (off_mm < 0 ? below : above) = true;
  }
  return below && above;
}

// Adds the places where lines are missing and no sample of all stands beside; false: the strip is
// not crossed by even lines.
bool AddMissed(const Strip& strip, const Strip& samples, double near_mm, Strip& missed) {
  const Strip lines = LinesOf(strip);
  if (lines.size() < kMissed.least_lines) return false;
  std::vector<double> gaps;
  for (std::size_t i = 1; i < lines.size(); ++i) gaps.push_back(lines[i].x() - lines[i - 1].x());
  const double gap_mm = Median(gaps);
  double even = 0, single = 0;
  for (const double gap : gaps) {
    const double times = std::max(1.0, std::round(gap / gap_mm));
    if (std::abs(gap / gap_mm - times) > kMissed.even * std::max(1.0, 0.1 * times)) continue;
    even += 1;
    single += times == 1 ? 1 : 0;
  }
  const auto n = static_cast<double>(gaps.size());
  if (even < kMissed.least_even * n || single + 1 < kMissed.least_single * n) return false;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const double times = std::round(gaps[i - 1] / gap_mm);
    if (times > kMissed.most_missing) continue;
    for (double k = 1; k < times; k += 1) {
      const Eigen::Vector2d place = lines[i - 1] + k / times * (lines[i] - lines[i - 1]);
      if (IsBetweenHits(samples, place, {kMissed.same_line * gap_mm, near_mm})) continue;
      missed.push_back(place);
    }
  }
  return true;
}

// Of one pass, if it comes in lines. `samples`: sorted along.
std::optional<MissedRays> MissedOf(const Strip& samples) {
  double low = 1e300, high = -1e300;
  for (const Eigen::Vector2d& sample : samples) {
    low = std::min(low, sample.y());
    high = std::max(high, sample.y());
  }
  if (!(high > low)) return std::nullopt;
  for (const std::size_t count : kMissed.strips) {
    std::vector<Strip> strips(count);
    for (const Eigen::Vector2d& sample : samples) {
      const double part = (sample.y() - low) / (high - low) * static_cast<double>(count);
      strips[std::min(count - 1, static_cast<std::size_t>(part))].push_back(sample);
    }
    MissedRays missed;
    missed.sideways_sigma_mm = (high - low) / (static_cast<double>(count) * std::sqrt(12.0));
    double with_samples = 0, crossed = 0;
    for (const Strip& strip : strips) {
      if (strip.empty()) continue;
      with_samples += 1;
      crossed +=
          AddMissed(strip, samples, kMissed.beside * (high - low) / static_cast<double>(count),
                    missed.places_mm)
              ? 1
              : 0;
    }
    if (crossed >= kMissed.least_strips * with_samples) return missed;
  }
  return std::nullopt;
}

}  // namespace

std::vector<MissedRays> FindMissed(std::span<const WallSample> wall, double pipe_radius_mm,
                                   const Eigen::Vector3d& outward,
                                   const Eigen::Vector3d& sideways) {
  struct Pass {
    Strip samples;
    Eigen::Vector3d to_sensor = Eigen::Vector3d::Zero();
  };
  std::map<unsigned, Pass> passes;
  for (const WallSample& sample : wall) {
    if (!sample.to_sensor.known()) continue;
    Pass& pass = passes[PassOf(sample.to_sensor)];
    const UnpackedDirection direction = UnpackDirection(sample.to_sensor);
    pass.samples.push_back(sample.place_mm);
    pass.to_sensor += Eigen::Vector3d(direction.x, direction.y, direction.z);
  }
  std::vector<MissedRays> all;
  for (auto& [number, pass] : passes) {
    std::sort(pass.samples.begin(), pass.samples.end(),
              [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) { return a.x() < b.x(); });
    auto missed = MissedOf(pass.samples);
    if (!missed) continue;
    MissedRays& rays = all.emplace_back(std::move(*missed));
    rays.to_sensor = pass.to_sensor / static_cast<double>(pass.samples.size());
    std::erase_if(rays.places_mm, [&](const Eigen::Vector2d& place) {
      const double sine = place.y() / pipe_radius_mm;
      if (std::abs(sine) >= 1) return true;
      const double cosine = std::sqrt(1.0 - sine * sine) * rays.to_sensor.dot(outward) +
                            sine * rays.to_sensor.dot(sideways);
      return cosine < kMissed.least_cosine;
    });
  }
  return all;
}

}  // namespace bendloop::pipeline
