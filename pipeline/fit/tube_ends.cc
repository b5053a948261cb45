// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_ends.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/math/circle_sectors.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

// Points that stand together. How near, in gaps; what part of the usual number is no fliers.
struct Crowd {
  double gaps, part;
};

struct EndSettings {
  // [sigma] From the surface; points further off are not the tube's.
  double on_surface = 4.0;
  // [of r_P] How far inward the local spacing is looked at. By trial.
  double window = 3.0;
  // [of r_P] The nodes reach this near to the tube's ends.
  double beyond_nodes = 2.0;
  // By trial; of scattered points so many that two or three fliers are no crowd.
  Crowd line_crowd = {1.0 / 3.0, 0.15}, scattered_crowd = {10.0, 0.3};
  // Usual number on a line; where fewer stand together the points are scattered. By trial.
  double least_crowd = 10.0;
  // Fewer points with a distance to the end tell nothing of their spacing. By trial.
  std::size_t least_points = 5;
  // One in so many points may lie before the tube's end. By trial.
  std::size_t begun = 20;
  // Of the mean gap: shorter ones are not those between laser lines. By trial.
  double least_gap = 0.3;
  // Of the mean gap: a point with a longer one behind it stands alone. By trial.
  double lone_gap = 4.0;
  // Of the mean gap between laser lines: scatter of those that are even. By trial.
  double even = 0.3;
  // A gap of scattered points over 1 sigma of their border: 2 if nothing else moved it. By trial.
  double scattered = 1.4;
  // [of r_P] Borders of sectors may be so far apart beyond their own width. By trial.
  double disagreement = 0.15;
  // Of the whole tube: their border is known better than the points of a scan lie apart.
  std::size_t enough_points = 100'000;
  // Of the walk: least points of a round, and most rounds. By trial.
  std::size_t points_of_round = 8192, most_rounds = 16;
};
constexpr EndSettings kEnds;
constexpr std::size_t kSectors = 16;  // of the turn about the end straights

struct Border {
  double at_mm = 0;
  double sigma_mm = 0;
  double least_mm = 0;  // other samples of the same end would hardly put it further out
};

// How the points of a straight follow each other along it.
struct Spacing {
  // Length-weighted mean gap: the distance between laser lines however dense they are along
  // themselves, and twice the mean gap of scattered points.
  double gap_mm = 0;
  double crowd_mm = 0;     // a point's crowd stands so near behind it: about a laser line's width
  double least_crowd = 0;  // points that are no fliers
  bool even = false;       // the gaps that matter are alike, as between laser lines
};

// How many points follow within `reach_mm` of point i, itself among them. `last`: the answer for a
// point before it, or i: where the search begins; becomes the end of the crowd.
double CrowdAt(std::span<const double> inward, std::size_t i, double reach_mm, std::size_t& last) {
  while (last < inward.size() && inward[last] <= inward[i] + reach_mm) ++last;
  return static_cast<double>(last - i);
}

Spacing SpacingWithin(std::span<const double> inward, std::size_t begin, std::size_t end) {
  Spacing spacing;
  double sum = 0, sum2 = 0;
  for (std::size_t k = begin; k + 1 < end; ++k) {
    const double gap = inward[k + 1] - inward[k];
    sum += gap;
    sum2 += gap * gap;
  }
  if (sum <= 0) return spacing;
  spacing.gap_mm = sum2 / sum;
  for (const auto& [gaps, part] : {kEnds.line_crowd, kEnds.scattered_crowd}) {
    spacing.crowd_mm = gaps * spacing.gap_mm;
    std::vector<double> crowds;
    crowds.reserve(end - begin);
    std::size_t last = begin;
    for (std::size_t k = begin; k + 1 < end; ++k) {
      crowds.push_back(CrowdAt(inward, k, spacing.crowd_mm, last));
    }
    const double usual = Median(std::move(crowds));
    spacing.least_crowd = part * usual;
    if (usual > kEnds.least_crowd) break;
  }
  double count = 0;
  sum = sum2 = 0;
  for (std::size_t k = begin; k + 1 < end; ++k) {
    const double gap = inward[k + 1] - inward[k];
    if (gap < kEnds.least_gap * spacing.gap_mm) continue;
    count += 1;
    sum += gap;
    sum2 += gap * gap;
  }
  const double mean = sum / std::max(1.0, count);
  spacing.even = count > 0 && sum2 / count - mean * mean < kEnds.even * kEnds.even * mean * mean;
  return spacing;
}

// Puts those of `inward` in front and in order that FindBorder looks at, which are few of many:
// up to a window and a quarter after where the straight certainly has begun, and the next one.
std::span<const double> SortBorder(std::span<double> inward, double pipe_radius_mm) {
  const auto begin = inward.begin() + static_cast<std::ptrdiff_t>(inward.size() / kEnds.begun);
  std::nth_element(inward.begin(), begin, inward.end());
  const double far_mm = *begin + 1.25 * kEnds.window * pipe_radius_mm;
  auto end = std::partition(begin, inward.end(), [far_mm](double at) { return at <= far_mm; });
  if (end != inward.end()) {
    std::iter_swap(end, std::min_element(end, inward.end()));
    ++end;
  }
  std::sort(inward.begin(), end);
  return {inward.begin(), end};
}

// `points`: distances along the straight, growing into the tube; changes their order.
std::optional<Border> FindBorder(std::span<double> points, double pipe_radius_mm) {
  if (points.size() < kEnds.least_points) return std::nullopt;
  const std::span<const double> inward = SortBorder(points, pipe_radius_mm);
  const std::size_t begin = points.size() / kEnds.begun;
  std::size_t end = begin;
  while (end < inward.size() && inward[end] < inward[begin] + kEnds.window * pipe_radius_mm) ++end;
  if (end - begin < 4) return std::nullopt;
  const Spacing spacing = SpacingWithin(inward, begin, end);
  if (spacing.gap_mm <= 0) return std::nullopt;
  std::size_t last = 0;
  for (std::size_t i = 0; i < end; ++i) {
    // Lone points beyond the tube are fliers; the border has as many neighbours as the rest.
    if (CrowdAt(inward, i, spacing.crowd_mm, last) < spacing.least_crowd) continue;
    if (i + 1 < inward.size() && inward[i + 1] - inward[i] > kEnds.lone_gap * spacing.gap_mm)
      continue;
    // The tube ends anywhere before the next line would have come, or one mean gap on.
    const double at_mm = inward[i] - 0.5 * spacing.gap_mm;
    // Scattered points begin behind the end by half a gap, give or take as much.
    return Border{at_mm, spacing.gap_mm / (spacing.even ? std::sqrt(12.0) : kEnds.scattered),
                  at_mm + (spacing.even ? 1.0 : 0.5) * spacing.gap_mm};
  }
  return std::nullopt;
}

// Distances along an end straight, growing into the tube, by the part of the turn around it.
using Sectors = std::array<std::vector<double>, kSectors>;

// The border that most of the circumference agrees on: a table that the tube lies on, or a clamp
// beside its end, goes on along a part of the turn only and is left out.
std::optional<Border> CommonBorder(Sectors& sectors, double pipe_radius_mm) {
  std::vector<double> borders, widths_mm;
  std::array<std::optional<Border>, kSectors> own;
  for (std::size_t i = 0; i < kSectors; ++i) {
    own[i] = FindBorder(sectors[i], pipe_radius_mm);
    if (!own[i]) continue;
    borders.push_back(own[i]->at_mm);
    widths_mm.push_back(own[i]->sigma_mm);
  }
  const double common = Median(borders);
  const double width_mm = Quantile(widths_mm, 1.0), usual_width_mm = Median(widths_mm);
  const double disagree_mm = kEnds.disagreement * pipe_radius_mm;
  const auto agrees = [&](const std::optional<Border>& border) {
    return border && border->least_mm >= common - disagree_mm - kEnds.scattered * usual_width_mm &&
           border->at_mm <= common + disagree_mm + kEnds.scattered * width_mm;
  };
  std::vector<double> pooled;
  for (std::size_t i = 0; i < kSectors; ++i) {
    if (!borders.empty() && !agrees(own[i])) continue;
    pooled.insert(pooled.end(), sectors[i].begin(), sectors[i].end());
  }
  return FindBorder(pooled, pipe_radius_mm);
}

// The points on the end straights.
struct EndPoints {
  Sectors from_start, from_end;
};

// Adds the block's points that are nearest to the first or the last segment.
class EndCollector {
 public:
  EndCollector(const hal::Tube& tube, double sigma_mm, EndPoints& points)
      : segments_(hal::SpineSegments(tube.program, tube.X_WT)),
        // The lines do not go on for ever: one may pass by the other end.
        frames_(SegmentFrames(segments_, kBeyond * tube.pipe_radius_mm)),
        pipe_radius_mm_(tube.pipe_radius_mm),
        reach_mm_(kEnds.on_surface * sigma_mm),
        points_(points) {}

  void Add(const PointBlock& block) {
    const auto last = static_cast<std::int32_t>(frames_.size()) - 1;
    CandidateSegments(block, frames_, 1.5 * pipe_radius_mm_, candidates_);
    if (candidates_.empty()) return;
    if (candidates_.front() != 0 && candidates_.back() != last) return;
    for (std::size_t first = 0; first < block.points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, block.points.size() - first);
      nearest_.Find(block.points.subspan(first, count), frames_, pipe_radius_mm_, candidates_);
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t c = EndOf(nearest_.Candidate(i), i);
        const LocalLanes& local = nearest_.Local(c);
        if (std::abs(local.distance[i] - pipe_radius_mm_) > reach_mm_) continue;
        // Further out another part of the tube may lie where the straight would go on.
        const double beyond_mm = kEnds.beyond_nodes * pipe_radius_mm_;
        const std::size_t sector = AzimuthSector<kSectors>(local.y[i], local.z[i]);
        if (candidates_[c] == 0 && local.x[i] >= -beyond_mm) {
          points_.from_start[sector].push_back(local.x[i]);
        }
        if (candidates_[c] == last && local.x[i] <= segments_.back().length_mm + beyond_mm) {
          points_.from_end[sector].push_back(-local.x[i]);
        }
      }
    }
  }

 private:
  // Where the two ends of a tube nearly meet, a point beyond the one lies on the other's straight,
  // which noise does not say: that is its candidate then, and `c` else.
  std::size_t EndOf(std::size_t c, std::size_t i) const {
    const auto last = static_cast<std::int32_t>(frames_.size()) - 1;
    if (last == 0 || candidates_.front() != 0 || candidates_.back() != last) return c;
    if (candidates_[c] != 0 && candidates_[c] != last) return c;
    const std::size_t other = c == 0 ? candidates_.size() - 1 : 0;
    const auto within = [&](std::size_t candidate) {
      const LocalLanes& local = nearest_.Local(candidate);
      const auto k = static_cast<std::size_t>(candidates_[candidate]);
      return local.x[i] >= 0 && local.x[i] <= segments_[k].length_mm &&
             std::abs(local.distance[i] - pipe_radius_mm_) <= reach_mm_;
    };
    return !within(c) && within(other) ? other : c;
  }

  std::vector<hal::SpineSegment> segments_;
  std::vector<SegmentFrame> frames_;
  double pipe_radius_mm_;
  double reach_mm_;
  EndPoints& points_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
};

// What all parts hold, in their order.
Sectors Joined(std::span<const EndPoints> parts, Sectors EndPoints::*which) {
  Sectors joined;
  for (const EndPoints& part : parts) {
    for (std::size_t i = 0; i < kSectors; ++i) {
      const std::vector<double>& from = (part.*which)[i];
      joined[i].insert(joined[i].end(), from.begin(), from.end());
    }
  }
  return joined;
}

}  // namespace

TubeEnds FindTubeEnds(const hal::Tube& tube, double sigma_mm, std::span<const PointBlock> all,
                      Workers* workers) {
  // An end that no sample shows is where the nodes stopped, give or take two pipe radii.
  const double unseen_mm = 2.0 * tube.pipe_radius_mm;
  TubeEnds ends{tube, unseen_mm, unseen_mm, false, false};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  const OwnedBlocks enough = Thinned(all, StrideTo(CountPoints(all), kEnds.enough_points));
  const std::span<const PointBlock> blocks = enough;
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kEnds.points_of_round, kEnds.most_rounds);
  std::vector<EndPoints> parts(rounds.size());
  ParallelFor(workers, rounds.size(), [&](std::size_t round) {
    EndCollector collector(tube, sigma_mm, parts[round]);
    for (std::size_t i = rounds[round].begin; i < rounds[round].end; ++i) {
      collector.Add(blocks[i]);
    }
  });
  std::array<std::optional<Border>, 2> borders;
  ParallelFor(workers, 2, [&](std::size_t end) {
    Sectors sectors = Joined(parts, end == 0 ? &EndPoints::from_start : &EndPoints::from_end);
    borders[end] = CommonBorder(sectors, tube.pipe_radius_mm);
  });
  auto& rows = ends.tube.program.rows;
  const double first_mm = rows.front().length_mm;
  double start_mm = 0;
  if (const auto& border = borders[0]) {
    start_mm = std::min(border->at_mm, first_mm);
    ends.first_sigma_mm = border->sigma_mm;
    ends.first_seen = true;
  }
  ends.tube.X_WT.position_mm += start_mm * segments.front().tangent;
  rows.front().length_mm = first_mm - start_mm;
  if (const auto& border = borders[1]) {
    ends.last_sigma_mm = border->sigma_mm;
    ends.last_seen = true;
    rows.back().length_mm = std::max(0.0, -border->at_mm - (last == 0 ? start_mm : 0.0));
  } else if (last == 0) {
    rows.back().length_mm -= start_mm;
  }
  return ends;
}

}  // namespace bendloop::pipeline
