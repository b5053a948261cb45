// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/tube_ends.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "pipeline/fit/facing_ends.h"
#include "pipeline/fit/nearest_lanes.h"
#include "pipeline/fit/trade_rows.h"
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
  // [of r_P] The nodes reach this near to the tube's ends; but those before what sits on it, where
  // the plain tube goes on behind that. Points that go on so far are followed further, step by
  // step, up to so far.
  double beyond_nodes = 2.0, most_beyond_nodes = 8.0;
  // [sigma] So near to where no more are looked at points go on; of thin ends, whose border is
  // vaguer than this [of r_P], it is told that they do (end_forms.h).
  double goes_on = 2.0, thin_end = 0.1;
  // By trial; of scattered points so many that two or three fliers are no crowd.
  Crowd line_crowd = {1.0 / 3.0, 0.15}, scattered_crowd = {10.0, 0.2};
  // Usual number on a line; where fewer stand together the points are scattered. By trial.
  double least_crowd = 10.0;
  // Fewer points with a distance to the end tell nothing of their spacing. By trial.
  std::size_t least_points = 5;
  // One in so many points may lie before the tube's end. By trial.
  std::size_t begun = 20;
  // Of the mean gap: shorter ones are not those between laser lines. By trial.
  double least_gap = 0.3;
  // So many points before the border tell how far apart they are there: by so many times more than
  // within the window they are in one of twelve by chance.
  std::size_t last_points = 10;
  double thinner = 1.5;
  // They grow thinner still up to the border: of their gap. By trial.
  double still_thinner = 1.5;
  // Of the mean gap: a point with a longer one behind it stands alone. By trial.
  double lone_gap = 4.0;
  // Of the mean gap of scattered points: up to here it may have been one of the tube by chance, and
  // the border is as unsure as half of that. By trial.
  double perhaps_lone_gap = 7.0;
  // Of the mean gap: a wider one parts what is no part of the tube's end from it, as the other end
  // of a frame that nearly closes. By trial.
  double torn_gap = 10.0;
  // Of the mean gap between laser lines: scatter of those that are even. By trial.
  double even = 0.3;
  // A gap of scattered points over 1 sigma of their border: 2 if nothing else moved it; a little
  // less keeps the exponential tail of where the first of them lies within six. By trial.
  double scattered = 1.9;
  // [of r_P] Borders of sectors may be so far apart beyond their own width. By trial.
  double disagreement = 0.15;
  // Of the points of sectors that tell a border: one that does not has as many of the tube. By
  // trial.
  double silent_part = 0.3;
  // [of r_P] What is pressed in is no deeper; and where the wall goes on beside it so far beyond
  // the border that all of the turn agrees on, and [sigma] of that, the tube does.
  double deepest_dent = 0.25, past_dent = 0.05, past_dent_sigmas = 4.0;
  // There, so many of the sectors of the turn that the tube is seen in have points, and the
  // shallowest of them is so deep, of the deepest.
  double filled = 0.75, shallow = 0.3;
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

// The same gap of scattered points as Spacing::gap_mm, by the next few behind point i.
double GapBehind(std::span<const double> inward, std::size_t i) {
  const std::size_t first = i + 1, last = std::min(i + kEnds.last_points, inward.size() - 1);
  if (last < first + kEnds.least_points) return 0.0;
  return 2.0 * (inward[last] - inward[first]) / static_cast<double>(last - first);
}

// The widest gap among the next few behind point i.
double WidestBehind(std::span<const double> inward, std::size_t i) {
  const std::size_t last = std::min(i + kEnds.last_points, inward.size() - 1);
  double widest_mm = 0;
  for (std::size_t k = i; k < last; ++k) widest_mm = std::max(widest_mm, inward[k + 1] - inward[k]);
  return widest_mm;
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
  double perhaps_mm = 0;  // to the lone point before
  for (std::size_t i = 0; i < end; ++i) {
    // Lone points beyond the tube are fliers; the border has as many neighbours as the rest.
    if (CrowdAt(inward, i, spacing.crowd_mm, last) < spacing.least_crowd) continue;
    // Where they grow thinner towards the end, the last of them count.
    const double last_mm = spacing.even ? 0.0 : GapBehind(inward, i);
    const bool is_thinner = last_mm > kEnds.thinner * spacing.gap_mm;
    const double lone_mm = kEnds.lone_gap * (is_thinner ? last_mm : spacing.gap_mm);
    if (i + 1 < inward.size() && inward[i + 1] - inward[i] > lone_mm) {
      const double to_next_mm = inward[i + 1] - inward[i];
      const bool is_perhaps =
          !spacing.even && to_next_mm < kEnds.perhaps_lone_gap / kEnds.lone_gap * lone_mm;
      perhaps_mm = is_perhaps ? to_next_mm : 0.0;
      continue;
    }
    if (WidestBehind(inward, i) > kEnds.torn_gap * spacing.gap_mm) continue;
    const double gap_mm = is_thinner ? kEnds.still_thinner * last_mm : spacing.gap_mm;
    // The tube ends anywhere before the next line would have come, or one mean gap on.
    const double at_mm = inward[i] - 0.5 * gap_mm;
    // Scattered points begin behind the end by half a gap, give or take as much.
    const double own_mm = gap_mm / (spacing.even ? std::sqrt(12.0) : kEnds.scattered);
    return Border{at_mm, std::hypot(own_mm, 0.5 * perhaps_mm),
                  at_mm + (spacing.even ? 1.0 : 0.5) * gap_mm};
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
  // Of a thin scan a sector's points may lie too far apart to tell a border by themselves.
  std::vector<double> counts;
  for (std::size_t i = 0; i < kSectors; ++i) {
    if (own[i]) counts.push_back(static_cast<double>(sectors[i].size()));
  }
  const double least_count = kEnds.silent_part * Median(std::move(counts));
  const auto is_silent = [&](std::size_t i) {
    return !own[i] && static_cast<double>(sectors[i].size()) >= least_count;
  };
  std::vector<double> pooled;
  for (std::size_t i = 0; i < kSectors; ++i) {
    if (!borders.empty() && !agrees(own[i]) && !is_silent(i)) continue;
    pooled.insert(pooled.end(), sectors[i].begin(), sectors[i].end());
  }
  return FindBorder(pooled, pipe_radius_mm);
}

// A point a little below the wall.
struct PressedPoint {
  double inward_mm = 0, depth_mm = 0;
};
using PressedSectors = std::array<std::vector<PressedPoint>, kSectors>;

// How deep the points of a sector lie between two places, on average; NaN: it has none there.
double MeanDepthMm(std::span<const double> wall, std::span<const PressedPoint> pressed,
                   double from_mm, double to_mm) {
  const auto is_within = [&](double at_mm) { return at_mm >= from_mm && at_mm <= to_mm; };
  double depth_mm = 0;
  auto points = static_cast<double>(std::count_if(wall.begin(), wall.end(), is_within));
  for (const PressedPoint& point : pressed) {
    if (!is_within(point.inward_mm)) continue;
    depth_mm += point.depth_mm;
    points += 1;
  }
  return depth_mm / points;
}

// The border of points on the wall, or of these and of those below it where a dent reaches round
// most of the turn: some sides lie far less deep than others then, and neither those of a bevel nor
// those of the bore do.
std::optional<Border> BorderPastDents(Sectors& wall, const PressedSectors& pressed, double r_mm) {
  const std::optional<Border> border = CommonBorder(wall, r_mm);
  if (!border) return border;
  // Where nothing lies below the wall beyond it there is no dent to go past.
  const bool has_pressed = std::any_of(pressed.begin(), pressed.end(), [&](const auto& sector) {
    return std::any_of(sector.begin(), sector.end(),
                       [&](const PressedPoint& point) { return point.inward_mm <= border->at_mm; });
  });
  if (!has_pressed) return border;
  Sectors both = wall;
  for (std::size_t i = 0; i < kSectors; ++i) {
    for (const PressedPoint& point : pressed[i]) both[i].push_back(point.inward_mm);
  }
  const std::optional<Border> past = CommonBorder(both, r_mm);
  if (!past) return border;
  const double further_mm = border->at_mm - past->at_mm;
  if (further_mm < std::max(kEnds.past_dent * r_mm, kEnds.past_dent_sigmas * border->sigma_mm)) {
    return border;
  }
  double seen = 0;
  std::vector<double> depths_mm;
  for (std::size_t i = 0; i < kSectors; ++i) {
    const double behind_mm = border->at_mm + kEnds.window * r_mm;
    if (std::isnan(MeanDepthMm(wall[i], pressed[i], border->at_mm, behind_mm))) continue;
    seen += 1;
    const double depth_mm = MeanDepthMm(wall[i], pressed[i], past->at_mm, border->at_mm);
    if (!std::isnan(depth_mm)) depths_mm.push_back(depth_mm);
  }
  if (static_cast<double>(depths_mm.size()) < std::max(2.0, kEnds.filled * seen)) return border;
  const auto [least, most] = std::minmax_element(depths_mm.begin(), depths_mm.end());
  return *least < kEnds.shallow * *most ? past : border;
}

// Points of an end straight, in its frame, as if it did not bow. Where it bows the tube's end leans
// as the spine does there, by L / 75 for a bow of L / 300. And best-fit lines pass each other by
// tenths of a millimetre, which no tube of lines and arcs has: lengths count from their corner.
class WithoutBow {
 public:
  WithoutBow() = default;
  // `straight`: with its corner [mm] along it. `line`: the same of the bowed spine.
  WithoutBow(const hal::SpineSegment& straight, double corner_mm, const hal::SpineSegment& line,
             double line_corner_mm, const Bow& bow)
      : bow_(bow),
        length_mm_(line.length_mm),
        turn_(line.axes().transpose() * straight.axes()),
        move_mm_(line.axes().transpose() * (straight.start_mm - line.start_mm)),
        shift_mm_(corner_mm - line_corner_mm) {}

  bool is_none() const { return !(length_mm_ > 0); }
  Eigen::Vector3d operator()(const Eigen::Vector3d& point) const {
    Eigen::Vector3d p = turn_ * point + move_mm_;
    const double x_mm = p.x();
    p.tail<2>() -= bow_.Beside(At(x_mm));
    p.x() += shift_mm_ + SlopeAt(x_mm).dot(p.tail<2>());
    return p;
  }
  // In the straight's frame: its spine where it is `along_mm` without bow, and its direction there.
  EndAxis AxisAt(double along_mm) const {
    const double x_mm = along_mm - shift_mm_;
    const Eigen::Vector2d off_mm = bow_.Beside(At(x_mm)), slope = SlopeAt(x_mm);
    return {turn_.transpose() * (Eigen::Vector3d(x_mm, off_mm[0], off_mm[1]) - move_mm_),
            turn_.transpose() * Eigen::Vector3d(1.0, slope[0], slope[1]).normalized()};
  }

 private:
  double At(double x_mm) const { return bow_.At(x_mm, length_mm_); }
  Eigen::Vector2d SlopeAt(double x_mm) const {
    return 2.0 / bow_.LengthMm(length_mm_) * bow_.SlopeAt(At(x_mm));
  }

  Bow bow_;
  double length_mm_ = 0;
  Eigen::Matrix3d turn_ = Eigen::Matrix3d::Identity();
  Eigen::Vector3d move_mm_ = Eigen::Vector3d::Zero();
  double shift_mm_ = 0;
};

// Of the first straight and of the last.
std::array<WithoutBow, 2> WithoutBows(const hal::Tube& tube,
                                      const std::vector<hal::SpineSegment>& segments,
                                      const BowedTubeState* bowed) {
  const std::size_t bends = tube.program.bend_count();
  if (!bowed || bowed->bows.empty() || bends == 0) return {};
  const EasedSpine spine = SpineOf(*bowed);
  const auto without = [&](std::size_t row, std::size_t next, std::size_t bend) {
    const std::size_t k = row * (spine.pieces + 1);
    const auto line_of = [&spine](std::size_t of_row) {
      const hal::SpineSegment& line = spine.segments[of_row * (spine.pieces + 1)];
      return SpineLine{line.start_mm, line.tangent};
    };
    const hal::BendRow& corner = tube.program.rows[bend];
    const double tangent_mm = corner.bend_radius_mm.value_or(0.0) *
                              std::tan(0.5 * corner.angle_deg * hal::kRadiansPerDegree);
    const hal::SpineSegment& straight = segments[2 * row];
    return WithoutBow(straight, row < next ? straight.length_mm + tangent_mm : -tangent_mm,
                      spine.segments[k], CornerAlongMm(line_of(row), line_of(next)),
                      bowed->bows[k]);
  };
  return {without(0, 1, 0), without(bends, bends - 1, bends - 1)};
}

// Of the straight that the tube ends on, `along_mm` from its start.
EndAxis AxisOf(const hal::SpineSegment& straight, const WithoutBow& without, double along_mm,
               bool at_start) {
  const EndAxis local = without.is_none()
                            ? EndAxis{Eigen::Vector3d(along_mm, 0, 0), Eigen::Vector3d::UnitX()}
                            : without.AxisAt(along_mm);
  const Eigen::Vector3d along = straight.axes() * local.outward;
  return {straight.start_mm + straight.axes() * local.end_mm,
          at_start ? Eigen::Vector3d(-along) : along};
}

// The points on the end straights, and those a little below their wall.
struct EndPoints {
  // Of the first end and of the last.
  std::array<Sectors, 2> wall;
  std::array<PressedSectors, 2> pressed;
};

// Adds the block's points that are nearest to the first or the last segment.
class EndCollector {
 public:
  // `beyond_mm`: of both ends, how far points may lie beyond the tube's.
  EndCollector(const hal::Tube& tube, double sigma_mm, const std::array<WithoutBow, 2>& without_bow,
               const std::optional<FacingEnds>& facing, const std::array<double, 2>& beyond_mm,
               EndPoints& points)
      : segments_(hal::SpineSegments(tube.program, tube.X_WT)),
        // The lines do not go on for ever: one may pass by the other end.
        frames_(
            SegmentFrames(segments_, tube.pipe_radius_mm + std::max(beyond_mm[0], beyond_mm[1]))),
        without_bow_(without_bow),
        facing_(facing),
        beyond_mm_(beyond_mm),
        pipe_radius_mm_(tube.pipe_radius_mm),
        reach_mm_(kEnds.on_surface * sigma_mm),
        deepest_mm_(std::max(reach_mm_, kEnds.deepest_dent * tube.pipe_radius_mm)),
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
        const std::size_t c = EndOf(nearest_.Candidate(i), i, block.points[first + i]);
        const LocalLanes& local = nearest_.Local(c);
        Eigen::Vector3d point(local.x[i], local.y[i], local.z[i]);
        double off_mm = local.distance[i] - pipe_radius_mm_;
        if (candidates_[c] != 0 && candidates_[c] != last) continue;
        if (const WithoutBow& without = without_bow_[candidates_[c] == 0 ? 0 : 1];
            !without.is_none()) {
          point = without(point);
          off_mm = point.tail<2>().norm() - pipe_radius_mm_;
        }
        if (off_mm > reach_mm_ || off_mm < -deepest_mm_) continue;
        AddPoint(point, candidates_[c], off_mm);
      }
    }
  }

 private:
  void AddPoint(const Eigen::Vector3d& point, std::int32_t segment, double off_mm) {
    // Further out another part of the tube may lie where the straight would go on.
    const std::size_t sector = AzimuthSector<kSectors>(point.y(), point.z());
    const auto add = [&](std::size_t end, double inward_mm) {
      if (off_mm < -reach_mm_) {
        points_.pressed[end][sector].push_back({inward_mm, -off_mm});
      } else {
        points_.wall[end][sector].push_back(inward_mm);
      }
    };
    if (segment == 0 && point.x() >= -beyond_mm_[0]) add(0, point.x());
    const auto last = static_cast<std::int32_t>(frames_.size()) - 1;
    if (segment == last && point.x() <= segments_.back().length_mm + beyond_mm_[1]) {
      add(1, -point.x());
    }
  }
  // Where the two ends of a tube nearly meet, a point beyond the one lies on the other's straight,
  // which noise does not say: that is its candidate then, and `c` else.
  std::size_t EndOf(std::size_t c, std::size_t i, const Eigen::Vector3d& point) const {
    const auto last = static_cast<std::int32_t>(frames_.size()) - 1;
    if (last == 0 || candidates_.front() != 0 || candidates_.back() != last) return c;
    if (candidates_[c] != 0 && candidates_[c] != last) return c;
    const std::size_t other = c == 0 ? candidates_.size() - 1 : 0;
    if (facing_) return facing_->IsOfStart(point) == (c == 0) ? c : other;
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
  const std::array<WithoutBow, 2>& without_bow_;
  const std::optional<FacingEnds>& facing_;
  std::array<double, 2> beyond_mm_;
  double pipe_radius_mm_;
  double reach_mm_, deepest_mm_;
  EndPoints& points_;
  std::vector<std::int32_t> candidates_;
  NearestLanes nearest_;
};

// What all parts hold of an end, in their order.
template <typename OfSectors>
OfSectors Joined(std::span<const EndPoints> parts, std::array<OfSectors, 2> EndPoints::*which,
                 std::size_t end) {
  OfSectors joined;
  for (const EndPoints& part : parts) {
    for (std::size_t i = 0; i < kSectors; ++i) {
      const auto& from = (part.*which)[end][i];
      joined[i].insert(joined[i].end(), from.begin(), from.end());
    }
  }
  return joined;
}

using Borders = std::array<std::optional<Border>, 2>;

// Of the first end and of the last, along their straights; of the last with the other sign.
Borders FindBorders(const hal::Tube& tube, const std::vector<hal::SpineSegment>& segments,
                    double sigma_mm, const std::array<WithoutBow, 2>& without_bow,
                    std::span<const PointBlock> all, Workers* workers) {
  const OwnedBlocks enough = Thinned(all, StrideTo(CountPoints(all), kEnds.enough_points));
  const std::span<const PointBlock> blocks = enough;
  const std::vector<BlockRange> rounds =
      EvenRounds(blocks, kEnds.points_of_round, kEnds.most_rounds);
  const auto facing =
      FacingEnds::Find(segments, tube.pipe_radius_mm, kEnds.on_surface * sigma_mm, blocks);
  const auto look = [&](const std::array<double, 2>& beyond_mm) {
    std::vector<EndPoints> parts(rounds.size());
    ParallelFor(workers, rounds.size(), [&](std::size_t round) {
      EndCollector collector(tube, sigma_mm, without_bow, facing, beyond_mm, parts[round]);
      for (std::size_t i = rounds[round].begin; i < rounds[round].end; ++i) {
        collector.Add(blocks[i]);
      }
    });
    Borders borders;
    ParallelFor(workers, 2, [&](std::size_t end) {
      Sectors wall = Joined(parts, &EndPoints::wall, end);
      const PressedSectors pressed = Joined(parts, &EndPoints::pressed, end);
      borders[end] = BorderPastDents(wall, pressed, tube.pipe_radius_mm);
    });
    return borders;
  };
  const std::array<double, 2> nodes_mm = {0.0, -segments.back().length_mm};
  const double step_mm = kEnds.beyond_nodes * tube.pipe_radius_mm;
  std::array<double, 2> beyond_mm = {step_mm, step_mm};
  Borders borders = look(beyond_mm);
  std::array<bool, 2> goes_on = {true, true};
  const auto reaches_limit = [&](std::size_t end) {
    if (!borders[end] || beyond_mm[end] > kEnds.most_beyond_nodes * tube.pipe_radius_mm)
      return false;
    if (borders[end]->sigma_mm > kEnds.thin_end * tube.pipe_radius_mm) return false;
    const double from_limit_mm = borders[end]->at_mm - nodes_mm[end] + beyond_mm[end];
    return from_limit_mm < kEnds.goes_on * borders[end]->sigma_mm;
  };
  while (true) {
    for (const std::size_t end : {0U, 1U}) {
      goes_on[end] = goes_on[end] && reaches_limit(end);
      if (goes_on[end]) beyond_mm[end] += step_mm;
    }
    if (!goes_on[0] && !goes_on[1]) return borders;
    const Borders further = look(beyond_mm);
    for (const std::size_t end : {0U, 1U}) {
      goes_on[end] = goes_on[end] && further[end] && further[end]->at_mm < borders[end]->at_mm;
      if (goes_on[end]) borders[end] = further[end];
    }
  }
}

}  // namespace

TubeEnds FindTubeEnds(const hal::Tube& tube, double sigma_mm, std::span<const PointBlock> all,
                      Workers* workers, const BowedTubeState* bowed) {
  // An end that no sample shows is where the nodes stopped, give or take two pipe radii.
  const double unseen_mm = 2.0 * tube.pipe_radius_mm;
  TubeEnds ends{tube, unseen_mm, unseen_mm, false, false, {}, {}};
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const std::array<WithoutBow, 2> without_bow = WithoutBows(tube, segments, bowed);
  const auto last = static_cast<std::int32_t>(segments.size()) - 1;
  const Borders borders = FindBorders(tube, segments, sigma_mm, without_bow, all, workers);
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
  ends.first = AxisOf(segments.front(), without_bow[0], start_mm, true);
  ends.last = AxisOf(segments.back(), without_bow[1],
                     rows.back().length_mm + (last == 0 ? start_mm : 0.0), false);
  return ends;
}

}  // namespace bendloop::pipeline
