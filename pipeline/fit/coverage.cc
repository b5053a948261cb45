// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/magnitude_histogram.h"
#include "pipeline/math/text.h"

namespace bendloop::pipeline {
namespace {

struct DescriptionSettings {
  // [sigma] Further from the surface a point is an outlier: there it has no weight in the fit.
  double outlier = kNoWeight;
  // [of r_P] So far beyond its ends points are still the tube's: a burr, noise. By trial.
  double margin = 0.2;
  // [of the points on and right beside the tube] More outliers are told.
  double many_outliers = 0.1;
  // [of r_P] What lies further off is no oval bend and no seam, whatever the noise. Where it is
  // such a part of the points of so long a stretch, and so many, it is told however few they are of
  // all.
  double far_off = 0.1, many_here = 0.4, long_stretch = 2.0, least_here = 30;
  // Points that are kept for deviations and pictures. By trial.
  std::size_t most_kept = 20'000;
  // [of r_P] Resolution of coverage and spine. Three neighbours tell whether a place is covered, so
  // that points are looked for within a pipe radius.
  double bin = 0.5;
  // Bounds the memory for tubes far longer than benders make them.
  double most_bins = 1e5;
  // Of the walk: least points of a round, and most rounds, each with bins of its own. By trial.
  std::size_t points_of_round = 8192, most_rounds = 8;
  // So many rounds at most run at a time: each with cells of the wall, of which there are many.
  std::size_t most_parts = 4;
};
constexpr DescriptionSettings kDescription;

// Places along the spine, one behind the other.
struct Bins {
  Bins(const EasedSpine& spine, double pipe_radius_mm)
      : length_mm(spine.length_mm()),
        bin_mm(std::max(kDescription.bin * pipe_radius_mm, length_mm / kDescription.most_bins)),
        count(static_cast<std::size_t>(std::ceil(length_mm / bin_mm)) + 1) {}

  double length_mm;  // of the tube
  double bin_mm;
  std::size_t count;
};

// What points say of the tube that they lie on.
struct Description {
  std::vector<std::uint32_t> count;  // by place along the spine
  std::vector<double> sum_mm;        // of their distances
  std::vector<std::uint32_t> off;    // of points beside the tube, by place
  std::vector<std::uint32_t> far;    // of these, such that are no noise and no oval bend's
  MagnitudeHistogram magnitudes;
  double sum2_mm2 = 0;
  std::size_t points = 0;
  std::vector<SurfaceSample> surface;

  void Add(const Description& other) {
    for (std::size_t bin = 0; bin < count.size(); ++bin) {
      count[bin] += other.count[bin];
      off[bin] += other.off[bin];
      far[bin] += other.far[bin];
      sum_mm[bin] += other.sum_mm[bin];
    }
    magnitudes.Add(other.magnitudes);
    sum2_mm2 += other.sum2_mm2;
    points += other.points;
    surface.insert(surface.end(), other.surface.begin(), other.surface.end());
  }
};

class Describer {
 public:
  // Every `sparse`-th point is kept for the surface. `cells`: counts the points on the wall; none:
  // nobody asks.
  Describer(const WallSpine& wall, std::span<const Flattening> flattening, double pipe_radius_mm,
            double sigma_mm, const Bins& bins, std::size_t sparse, WallCellCounter* cells,
            Description& description)
      : wall_(wall),
        segments_(wall.spine.segments),
        frames_(SegmentFrames(wall.spine, kBeyond * pipe_radius_mm, {})),
        flattened_(flattening.empty()
                       ? std::vector<SegmentFrame>()
                       : SegmentFrames(wall.spine, kBeyond * pipe_radius_mm, flattening)),
        pipe_radius_mm_(pipe_radius_mm),
        length_mm_(bins.length_mm),
        reach_mm_(kDescription.outlier * sigma_mm),
        inverse_bin_(1.0 / bins.bin_mm),
        sparse_(sparse),
        is_sharp_(wall.spine.pieces == 1),
        cells_(cells),
        out_(description) {
    out_.count.assign(bins.count, 0);
    out_.sum_mm.assign(bins.count, 0.0);
    out_.off.assign(bins.count, 0);
    out_.far.assign(bins.count, 0);
  }

  // `index`: of the block's first point among all.
  void Add(const PointBlock& block, std::size_t index) {
    // As far as cells count, so that they find their points here, too.
    CandidateSegments(block, frames_, WallCellCounter::kNearSegment * pipe_radius_mm_, candidates_);
    const bool shares = cells_ && is_sharp_ && cells_->Shares(block, candidates_);
    if (cells_ && !shares) cells_->Add(block, index);
    if (candidates_.empty()) return;
    along_mm_.resize(std::max(along_mm_.size(), candidates_.size()));
    inside_mm_.resize(along_mm_.size());
    // Counted down: a division for each point would cost more than all the rest.
    std::size_t until_kept = (sparse_ - index % sparse_) % sparse_;
    for (std::size_t first = 0; first < block.points.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, block.points.size() - first);
      nearest_.Find(block.points.subspan(first, count), frames_, pipe_radius_mm_, candidates_);
      for (std::size_t c = 0; c < candidates_.size(); ++c) {
        const SegmentFrame& frame = frames_[static_cast<std::size_t>(candidates_[c])];
        if (frame.bend_radius_mm > 0) AlongArc(frame, nearest_.Local(c), count, along_mm_[c]);
        SetInside(c, count);
      }
      if (shares) cells_->AddShared(nearest_, candidates_, along_mm_, count, index + first);
      for (std::size_t i = 0; i < count; ++i) {
        const bool keep = until_kept == 0;
        until_kept = keep ? sparse_ - 1 : until_kept - 1;
        Add(block.points[first + i], i, keep);
      }
    }
  }

 private:
  // How far the wall of flattened bends, and of straights that bow, lies inside the round one.
  void SetInside(std::size_t candidate, std::size_t count) {
    if (!wall_.bows.empty() || !flattened_.empty()) inside_mm_[candidate].fill(0.0);
    const auto k = static_cast<std::size_t>(candidates_[candidate]);
    if (!wall_.bows.empty() && !wall_.bows[k].is_none()) {
      const auto& local = nearest_.Local(candidate);
      const Bow& bow = wall_.bows[k];
      for (std::size_t i = 0; i < count; ++i) {
        const Eigen::Vector2d beside_mm = bow.Beside(bow.At(local.x[i], segments_[k].length_mm));
        inside_mm_[candidate][i] =
            -(beside_mm.x() * local.y[i] + beside_mm.y() * local.z[i]) / local.distance[i];
      }
    }
    if (flattened_.empty()) return;
    const SegmentFrame& frame = flattened_[static_cast<std::size_t>(candidates_[candidate])];
    if (!frame.is_flattened()) return;
    FlattenedBy(frame, pipe_radius_mm_, nearest_.Local(candidate), flattened_mm_);
    for (std::size_t i = 0; i < count; ++i) inside_mm_[candidate][i] += flattened_mm_[i];
  }
  void Add(const Eigen::Vector3d& point, std::size_t i, bool keep) {
    const std::size_t c = nearest_.Candidate(i);
    const auto k = static_cast<std::size_t>(candidates_[c]);
    const double off_round_mm = nearest_.Local(c).distance[i] - pipe_radius_mm_;
    const bool is_round = flattened_.empty() && wall_.bows.empty();
    const double d = is_round ? off_round_mm : off_round_mm + inside_mm_[c][i];
    const double along_mm =
        frames_[k].bend_radius_mm > 0
            ? along_mm_[c][i]
            : std::clamp(nearest_.Local(c).x[i], frames_[k].low_mm, frames_[k].high_mm);
    const double s = segments_[k].from_start_mm + along_mm;
    const double margin_mm = kDescription.margin * pipe_radius_mm_;
    if (s < -margin_mm || s > length_mm_ + margin_mm) return;
    const auto bin = static_cast<std::size_t>(std::clamp(s, 0.0, length_mm_) * inverse_bin_);
    if (!(std::abs(d) <= reach_mm_)) {
      if (d >= pipe_radius_mm_) return;  // beside another part
      ++out_.off[bin];
      if (std::abs(d) > kDescription.far_off * pipe_radius_mm_) ++out_.far[bin];
      return;
    }
    out_.magnitudes.Add(d);
    out_.sum2_mm2 += d * d;
    ++out_.points;
    if (keep) out_.surface.push_back({point, off_round_mm});
    ++out_.count[bin];
    out_.sum_mm[bin] += off_round_mm;
  }

  const WallSpine& wall_;
  const std::vector<hal::SpineSegment>& segments_;
  std::vector<SegmentFrame> frames_, flattened_;
  double pipe_radius_mm_, length_mm_, reach_mm_, inverse_bin_;
  std::size_t sparse_;
  bool is_sharp_;
  WallCellCounter* cells_;
  Description& out_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
  WallCellCounter::AlongArcs along_mm_;
  std::vector<std::array<double, kBatch>> inside_mm_;  // by candidate
  std::array<double, kBatch> flattened_mm_{};
};

// A walk over all points. `cells`: becomes where they are, if it has any.
Description Describe(std::span<const PointBlock> blocks, const WallSpine& wall,
                     std::span<const Flattening> flattening, const hal::Tube& tube, double sigma_mm,
                     const Bins& bins, EmptyWallCells& cells, Workers* workers) {
  const std::size_t sparse = CountPoints(blocks) / kDescription.most_kept + 1;
  std::vector<std::size_t> first_index;
  std::size_t index = 0;
  for (const PointBlock& block : blocks) {
    first_index.push_back(index);
    index += block.points.size();
  }
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kDescription.points_of_round, kDescription.most_rounds);
  std::vector<Description> descriptions(rounds.size());
  // Numbers of points add up to the same however the rounds are parted; what they sum does not.
  const bool counts = !cells.cells.count.empty();
  std::vector<WallCells> parts(workers ? std::min(rounds.size(), kDescription.most_parts) : 1);
  ParallelFor(workers, parts.size(), [&](std::size_t part) {
    std::optional<WallCellCounter> counter;
    if (counts) counter.emplace(tube, cells);
    const std::size_t end = (part + 1) * rounds.size() / parts.size();
    for (std::size_t round = part * rounds.size() / parts.size(); round < end; ++round) {
      Describer describer(wall, flattening, tube.pipe_radius_mm, sigma_mm, bins, sparse,
                          counts ? &*counter : nullptr, descriptions[round]);
      for (std::size_t i = rounds[round].begin; i < rounds[round].end; ++i) {
        describer.Add(blocks[i], first_index[i]);
      }
    }
    if (counts) parts[part] = counter->TakeCells();
  });
  for (std::size_t round = 1; round < descriptions.size(); ++round) {
    descriptions.front().Add(descriptions[round]);
  }
  for (std::size_t part = 0; counts && part < parts.size(); ++part) {
    if (part == 0) cells.cells = std::move(parts.front());
    if (part > 0) cells.cells.Add(parts[part]);
  }
  return std::move(descriptions.front());
}

void SetDistances(const Description& points, std::size_t all_samples, FitQuality& fit) {
  fit.samples = points.points;
  fit.outliers = all_samples - std::min(all_samples, points.points);
  fit.rms_distance_mm =
      points.points == 0 ? 0.0 : std::sqrt(points.sum2_mm2 / static_cast<double>(points.points));
  fit.p95_abs_distance_mm = points.magnitudes.Quantile(0.95);
  fit.median_abs_distance_mm = points.magnitudes.Quantile(0.5);
}

// More outliers right beside the tube than fliers and a neighbour's edge make are told, with where
// they lie. What stands away from it, a table above all, stands so in every scan of a cell.
void SayOutliers(const Bins& bins, const Description& points, Measurement& measurement) {
  double beside = 0;
  for (const std::uint32_t count : points.off) beside += count;
  const double near = beside + static_cast<double>(measurement.fit.samples);
  if (!(beside > kDescription.many_outliers * near)) return;
  // From where to where the middle four fifths of them lie.
  double before = 0;
  std::size_t from = bins.count - 1, to = 0;
  for (std::size_t bin = 0; bin < bins.count; ++bin) {
    if (before <= 0.9 * beside) to = bin;
    before += points.off[bin];
    if (before >= 0.1 * beside) from = std::min(from, bin);
  }
  const auto at = [&](std::size_t bin) {
    return Fixed(std::min(static_cast<double>(bin) * bins.bin_mm, bins.length_mm), 0);
  };
  measurement.warnings.push_back(
      Fixed(100.0 * beside / near, 0) +
      " % of the points beside the tube do not lie on it, most of them from " + at(from) + " to " +
      at(to + 1) + " mm along it: what is there has another shape, or something touches the tube");
}

// Stretches of the tube, but what sits on its ends, where much of the wall lies elsewhere: few of
// all points, and yet no tube.
void SayOtherSections(const Bins& bins, const Description& points, Measurement& measurement) {
  const double r_mm = measurement.tube.pipe_radius_mm;
  const auto window =
      static_cast<std::size_t>(std::ceil(kDescription.long_stretch * r_mm / bins.bin_mm));
  const auto bin_of = [&bins](double at_mm) {
    return static_cast<std::size_t>(std::max(0.0, std::ceil(at_mm / bins.bin_mm)));
  };
  const std::size_t first = bin_of(measurement.first_end.length_mm + r_mm);
  const std::size_t end = bin_of(bins.length_mm - measurement.last_end.length_mm - r_mm);
  const auto is_other = [&](std::size_t from) {
    double far = 0, all = 0;
    for (std::size_t bin = from; bin < from + window; ++bin) {
      far += points.far[bin];
      all += points.count[bin] + points.off[bin];
    }
    return far > kDescription.least_here && far > kDescription.many_here * all;
  };
  for (std::size_t from = first; from + window < end; ++from) {
    if (!is_other(from)) continue;
    std::size_t to = from;  // the last window
    while (to + 1 + window < end && is_other(to + 1)) ++to;
    to += window;
    const auto at = [&](std::size_t bin) {
      return Fixed(static_cast<double>(bin) * bins.bin_mm, 0);
    };
    measurement.warnings.push_back("much of the wall from " + at(from) + " to " + at(to) +
                                   " mm along the tube lies more than " +
                                   Fixed(100.0 * kDescription.far_off, 0) +
                                   " % of the pipe radius off it: it is pressed flat there, or "
                                   "something is around it");
    from = to;
  }
}

// A place is covered when samples lie within a pipe radius along the spine: laser lines further
// apart than that leave gaps that a bend could hide in.
void SetCoverage(const Bins& bins, std::span<const std::uint32_t> count, Measurement& measurement) {
  const auto covered = [&](std::size_t bin) {
    const std::size_t low = bin == 0 ? 0 : bin - 1;
    const std::size_t high = std::min(bin + 1, bins.count - 1);
    return count[low] + count[bin] + count[high] > 0;
  };
  double uncovered_mm = 0, gap_mm = 0;
  measurement.longest_gap_mm = 0;
  for (std::size_t bin = 0; bin + 1 < bins.count; ++bin) {
    // What sits on an end hides the tube and is no gap.
    const double from_mm = static_cast<double>(bin) * bins.bin_mm;
    if (from_mm < measurement.first_end.length_mm ||
        from_mm + bins.bin_mm > bins.length_mm - measurement.last_end.length_mm) {
      gap_mm = 0;
      continue;
    }
    if (covered(bin)) {
      gap_mm = 0;
      continue;
    }
    uncovered_mm += bins.bin_mm;
    gap_mm += bins.bin_mm;
    measurement.longest_gap_mm = std::max(measurement.longest_gap_mm, gap_mm);
  }
  measurement.coverage =
      bins.length_mm > 0 ? std::clamp(1.0 - uncovered_mm / bins.length_mm, 0.0, 1.0) : 0.0;
}

// The spine with the radius that the points have there.
void SetSpine(const Bins& bins, const std::vector<hal::SpineSegment>& segments,
              const Description& points, Measurement& measurement) {
  measurement.spine.clear();
  std::size_t segment = 0;
  for (std::size_t bin = 0; bin < bins.count; ++bin) {
    const double s = std::min(static_cast<double>(bin) * bins.bin_mm, bins.length_mm);
    while (segment + 1 < segments.size() &&
           s > segments[segment].from_start_mm + segments[segment].length_mm) {
      ++segment;
    }
    const double mean_mm = points.count[bin] > 0 ? points.sum_mm[bin] / points.count[bin] : 0.0;
    measurement.spine.push_back({segments[segment].PointAt(s - segments[segment].from_start_mm),
                                 measurement.tube.pipe_radius_mm + mean_mm});
  }
}

}  // namespace

WallCells DescribeSamples(std::span<const PointBlock> blocks, std::size_t all_samples,
                          const WallSpine& wall, double sigma_mm, Measurement& measurement,
                          Workers* workers) {
  const hal::Tube& tube = measurement.tube;
  const Bins bins(wall.spine, tube.pipe_radius_mm);
  EmptyWallCells cells = EmptyCellsOf(tube, blocks);
  Description points =
      Describe(blocks, wall, measurement.flattening, tube, sigma_mm, bins, cells, workers);
  SetDistances(points, all_samples, measurement.fit);
  SayOutliers(bins, points, measurement);
  SayOtherSections(bins, points, measurement);
  SetCoverage(bins, points.count, measurement);
  SetSpine(bins, wall.spine.segments, points, measurement);
  measurement.surface = std::move(points.surface);
  return std::move(cells.cells);
}

}  // namespace bendloop::pipeline
