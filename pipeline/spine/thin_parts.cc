// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/thin_parts.h"

#include <Eigen/Dense>
#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/math/circle_sectors.h"

namespace bendloop::pipeline {
namespace {

// Where a tube goes on, and how it is followed. Lengths in pipe radii; by trial where nothing else
// is said.
struct ThinSettings {
  // Samples about a place from here to there along the spine are looked at; a hundredth of a usual
  // scan's leave a dozen ahead.
  double behind = 1.5, ahead = 2.5;
  // From a place to the next, but for the last.
  double step = 0.5, least_step = 0.1;
  // Samples so far off the surface may be the tube's; a straight that is laid where a bend has
  // begun is off by that.
  double inlier = 0.25;
  // What is nearer to the spine than that is the tube's, or something else is there.
  double beside = 1.8;
  // Of these the tube's are so many at least.
  double least_part = 0.7;
  // Samples ahead that tell of a tube, and how far it is from one to the next at most.
  std::size_t least_ahead = 5;
  double longest_gap = 2.0;
  // Of sixteen sides of the pipe: a plane that touches it has fewer.
  std::size_t least_sides = 4;
  // A shorter way, or one with fewer samples, is no tube that goes on: the last node lies up to a
  // pipe radius before the end of any.
  double least_way = 2.0;
  std::size_t least_samples = 8;
  // The last node lies less than that before the end of a tube that is seen well.
  double beyond_end = 1.2;
  // Of a slice across the tube, and samples of it that are enough.
  double slice = 0.25;
  std::size_t enough = 12;
  // 1 sigma of a place across the spine, of its direction [rad], and of how its curvature [1/r_P]
  // differs from that of the place before; of a sample.
  double place_sigma = 0.1, turn_sigma = 0.1, curvature_sigma = 0.3, sample_sigma = 0.03;
  // [1/r_P] The tightest that a die bends, and how finely bends are tried.
  double most_curvature = 0.67;
  int curvatures = 4, directions = 12, steps = 4;
  // Nodes so far before a place along the spine are no other part of the tube, which is no nearer
  // to it than the pipe is wide.
  double own = 6.0, apart = 1.7;
  // A curve that lies so near to where the way led is the same.
  double same = 0.6;
  // Nodes further apart have a gap between them. The way through it ends at most so many times
  // further on.
  double gap = 1.5, longest_detour = 2.0;
  std::size_t most_places = 4000;
};
constexpr ThinSettings kThin;
constexpr unsigned kThinSides = 16;

using Vector6d = Eigen::Matrix<double, 6, 1>;

// A sample as a piece of arc sees it, in pipe radii.
struct Seen {
  double along = 0, off = 0;  // off: from the surface
  Eigen::Vector3d outward;    // unit, across the arc
  Eigen::Vector3d foot;       // of the arc, from its place
  double x = 0, y = 0;        // of `outward`, for its side
};

// A piece of arc in pipe radii, about the place where it begins.
struct Arc {
  Eigen::Vector3d place, tangent;
  Eigen::Vector3d curvature = Eigen::Vector3d::Zero();  // towards its middle, across the tangent
  static constexpr double kStraight = 1e-6;             // [1/r_P] less curved is a line

  Seen Look(const Eigen::Vector3d& sample) const {
    const Eigen::Vector3d v = sample - place;
    const double k = curvature.norm();
    Seen seen;
    if (k < kStraight) {
      seen.along = v.dot(tangent);
      seen.foot = seen.along * tangent;
    } else {
      const Eigen::Vector3d inward = curvature / k;
      const double turn = std::atan2(v.dot(tangent), 1.0 / k - v.dot(inward));
      seen.along = turn / k;
      seen.foot = std::sin(turn) / k * tangent + (1.0 - std::cos(turn)) / k * inward;
    }
    const Eigen::Vector3d across = v - seen.foot;
    const double rho = std::max(1e-9, across.norm());
    seen.outward = across / rho;
    seen.off = rho - 1.0;
    const Eigen::Vector3d u = tangent.unitOrthogonal();
    seen.x = seen.outward.dot(u);
    seen.y = seen.outward.dot(tangent.cross(u));
    return seen;
  }
  // The arc from `along` on.
  Arc From(double along) const {
    const double k = curvature.norm();
    if (k < kStraight) return {place + along * tangent, tangent, curvature};
    const Eigen::Vector3d inward = curvature / k;
    const double turn = along * k, c = std::cos(turn), s = std::sin(turn);
    return {place + (s * tangent + (1.0 - c) * inward) / k, c * tangent + s * inward,
            k * (c * inward - s * tangent)};
  }
  void Bound() {
    curvature -= curvature.dot(tangent) * tangent;
    const double k = curvature.norm();
    if (k > kThin.most_curvature) curvature *= kThin.most_curvature / k;
  }
};

bool IsInWindow(const Seen& seen) { return seen.along > -kThin.behind && seen.along < kThin.ahead; }
// Tukey's. `off`: from the surface.
double WeightOf(double off) {
  off /= kThin.inlier;
  const double w = 1.0 - off * off;
  return w > 0 ? w * w : 0.0;
}

// Weights of the samples that the arc sees, added up. As by Look(), but without angles: of many
// arcs the best is asked for.
double ScoreOf(const Arc& arc, std::span<const Eigen::Vector3d> samples) {
  const double k = arc.curvature.norm();
  const bool is_straight = k < Arc::kStraight;
  const Eigen::Vector3d inward = arc.curvature / std::max(k, Arc::kStraight);
  const double radius = is_straight ? 0.0 : 1.0 / k;
  // The window as a sector about the arc's middle, of less than half a turn.
  const double low_c = std::cos(kThin.behind * k), low_s = std::sin(kThin.behind * k);
  const double high_c = std::cos(kThin.ahead * k), high_s = std::sin(kThin.ahead * k);
  double sum = 0;
  for (const Eigen::Vector3d& sample : samples) {
    const Eigen::Vector3d v = sample - arc.place;
    const double x = v.dot(arc.tangent), y = is_straight ? 0.0 : v.dot(inward);
    const double from_middle = radius - y;
    const bool in_window =
        is_straight ? x > -kThin.behind && x < kThin.ahead
                    : x * low_c > -from_middle * low_s && from_middle * high_s > x * high_c;
    if (!in_window) continue;
    const double beyond = std::sqrt(x * x + from_middle * from_middle) - radius;
    const double in_plane2 = is_straight ? 0.0 : beyond * beyond - y * y;
    const double rho = std::sqrt(std::max(0.0, v.squaredNorm() - x * x + in_plane2));
    sum += WeightOf(rho - 1.0);
  }
  return sum;
}

// One end of a curve on its way.
class Way {
 public:
  Way(const SampleGrid& grid, double pipe_radius_mm, const SpinePolygon& polygon)
      : grid_(grid), r_mm_(pipe_radius_mm), polygon_(polygon) {}

  // Nodes beyond the polygon's last, in the order of the way; none: it ends there.
  SpinePolygon Follow() {
    const SpinePolygon nodes = Go(std::numeric_limits<double>::infinity(), nullptr);
    const bool goes_on = way_ >= kThin.least_way && passed_ >= kThin.least_samples;
    return goes_on ? nodes : SpinePolygon{};
  }
  // The same as far as a node behind a gap; none: it does not come there.
  SpinePolygon FollowTo(const SpineNode& goal) {
    const double gap = (goal.position_mm - polygon_.back().position_mm).norm() / r_mm_;
    SpinePolygon nodes = Go(kThin.longest_detour * gap, &goal);
    return is_there_ ? nodes : SpinePolygon{};
  }

 private:
  SpinePolygon Go(double longest, const SpineNode* goal) {
    Arc arc{polygon_.back().position_mm / r_mm_, polygon_.back().tangent};
    Gather(arc);
    if (!MayGoOn(arc)) return {};
    SpinePolygon nodes;
    while (nodes.size() < kThin.most_places && way_ < longest) {
      const auto ahead = GoAlong(arc);
      if (!ahead) break;
      const double step = std::min(kThin.step, ahead->farthest);
      if (step < kThin.least_step) break;
      arc = arc.From(step);
      way_ += step;
      passed_ += ahead->passed;
      if (IsAtTube(arc)) return {};
      is_there_ = goal && (goal->position_mm / r_mm_ - arc.place).norm() < kThin.same;
      if (is_there_) break;
      nodes.push_back({r_mm_ * arc.place, arc.tangent, r_mm_ * ahead->rms, ahead->samples});
      if (step < kThin.step) break;
      Gather(arc);
    }
    return nodes;
  }

  struct Ahead {
    double farthest = 0;  // sample that is the tube's
    double rms = 0;
    std::size_t samples = 0;  // of the tube, ahead and behind
    std::size_t passed = 0;   // within a step
  };

  void Gather(const Arc& arc) {
    const double middle = 0.5 * (kThin.ahead - kThin.behind);
    const double reach = 0.5 * (kThin.ahead + kThin.behind) + kThin.beside;
    grid_.GatherBall(r_mm_ * (arc.place + middle * arc.tangent), r_mm_ * reach, gathered_);
    // No more of where they are many, evenly along the tube.
    std::map<int, std::vector<std::size_t>> slices;
    for (std::size_t i = 0; i < gathered_.size(); ++i) {
      const double along = (gathered_[i] / r_mm_ - arc.place).dot(arc.tangent);
      slices[static_cast<int>(std::floor(along / kThin.slice))].push_back(i);
    }
    samples_.clear();
    for (const auto& [at, slice] : slices) {
      const std::size_t stride = (slice.size() + kThin.enough - 1) / kThin.enough;
      for (std::size_t i = 0; i < slice.size(); i += stride) {
        samples_.push_back(gathered_[slice[i]] / r_mm_);
      }
    }
  }

  // What is certainly no tube that goes on, for a start. Of one that bends at once a part lies so
  // far ahead, too.
  bool MayGoOn(const Arc& arc) const {
    const auto beyond =
        std::count_if(samples_.begin(), samples_.end(), [&arc](const Eigen::Vector3d& sample) {
          return (sample - arc.place).dot(arc.tangent) > kThin.beyond_end;
        });
    return static_cast<std::size_t>(beyond) >= kThin.least_ahead;
  }

  // The arc that most samples ahead lie on, from where and whereto it goes now.
  void Turn(Arc& arc) const {
    const Eigen::Vector3d u = arc.tangent.unitOrthogonal(), v = arc.tangent.cross(u);
    Arc best = arc;
    double most = ScoreOf(arc, samples_);
    const auto ask = [&](const Eigen::Vector3d& curvature) {
      Arc trial = arc;
      trial.curvature = curvature;
      const double is = ScoreOf(trial, samples_);
      if (is > most) best = trial, most = is;
    };
    ask(Eigen::Vector3d::Zero());
    for (int i = 1; i <= kThin.curvatures; ++i) {
      for (int k = 0; k < kThin.directions; ++k) {
        const double side = 2.0 * std::numbers::pi * k / kThin.directions;
        ask(kThin.most_curvature * i / kThin.curvatures *
            (std::cos(side) * u + std::sin(side) * v));
      }
    }
    arc = best;
  }

  // Least squares from there.
  void Settle(Arc& arc) const {
    const Eigen::Vector3d usual = arc.curvature;
    for (int step = 0; step < kThin.steps; ++step) {
      const Eigen::Vector3d u = arc.tangent.unitOrthogonal(), v = arc.tangent.cross(u);
      Vector6d certainty;
      certainty << 1, 1, 1, 1, 1, 1;
      certainty.head<2>() *= std::pow(kThin.sample_sigma / kThin.place_sigma, 2);
      certainty.segment<2>(2) *= std::pow(kThin.sample_sigma / kThin.turn_sigma, 2);
      certainty.tail<2>() *= std::pow(kThin.sample_sigma / kThin.curvature_sigma, 2);
      Eigen::Matrix<double, 6, 6> left = certainty.asDiagonal();
      Vector6d right = Vector6d::Zero();
      const Eigen::Vector3d back = usual - arc.curvature;
      right.tail<2>() << certainty[4] * back.dot(u), certainty[5] * back.dot(v);
      for (const Eigen::Vector3d& sample : samples_) {
        const Seen seen = arc.Look(sample);
        if (!IsInWindow(seen)) continue;
        const double weight = WeightOf(seen.off);
        if (weight <= 0) continue;
        // How the surface moves outwards there.
        const double far = seen.foot.dot(arc.tangent);
        const double of_u = seen.outward.dot(u), of_v = seen.outward.dot(v);
        const double of_t = seen.outward.dot(arc.tangent);
        const double half = 0.5 * seen.along * seen.along;
        Vector6d row;
        row << of_u, of_v, far * of_u - seen.foot.dot(u) * of_t,
            far * of_v - seen.foot.dot(v) * of_t, half * of_u, half * of_v;
        left += weight * row * row.transpose();
        right += weight * seen.off * row;
      }
      const Vector6d by = left.ldlt().solve(right);
      if (!by.allFinite()) return;
      arc.place += by[0] * u + by[1] * v;
      arc.tangent = (arc.tangent + by[2] * u + by[3] * v).normalized();
      arc.curvature += by[4] * u + by[5] * v;
      arc.Bound();
    }
  }

  // None: the tube ends here.
  std::optional<Ahead> GoAlong(Arc& arc) const {
    Turn(arc);
    Settle(arc);
    Ahead found;
    std::vector<double> along;
    std::bitset<kThinSides> sides;
    std::size_t near = 0;
    double squares = 0;
    for (const Eigen::Vector3d& sample : samples_) {
      const Seen seen = arc.Look(sample);
      if (!IsInWindow(seen) || seen.off > kThin.beside - 1.0) continue;
      if (seen.along > 0) ++near;
      if (std::abs(seen.off) > kThin.inlier) continue;
      ++found.samples;
      squares += seen.off * seen.off;
      sides.set(AzimuthSector<kThinSides>(seen.x, seen.y));
      if (seen.along > 0) along.push_back(seen.along);
    }
    if (along.size() < kThin.least_ahead || sides.count() < kThin.least_sides) return std::nullopt;
    if (static_cast<double>(along.size()) < kThin.least_part * static_cast<double>(near)) {
      return std::nullopt;
    }
    std::sort(along.begin(), along.end());
    for (const double at : along) {
      if (at > found.farthest + kThin.longest_gap) break;
      found.farthest = at;
      if (at < kThin.step) ++found.passed;
    }
    found.rms = std::sqrt(squares / static_cast<double>(found.samples));
    return found;
  }

  // Whether the way has come to another part of the tube.
  bool IsAtTube(const Arc& arc) const {
    double left_mm = kThin.own * r_mm_;
    for (std::size_t i = polygon_.size(); i-- > 0;) {
      if (i + 1 < polygon_.size()) {
        left_mm -= (polygon_[i + 1].position_mm - polygon_[i].position_mm).norm();
      }
      if (left_mm < 0 && (polygon_[i].position_mm / r_mm_ - arc.place).norm() < kThin.apart) {
        return true;
      }
    }
    return false;
  }

  const SampleGrid& grid_;
  double r_mm_;
  const SpinePolygon& polygon_;
  std::vector<Eigen::Vector3d> gathered_, samples_;
  double way_ = 0;
  std::size_t passed_ = 0;  // samples
  bool is_there_ = false;   // at the goal
};

// Most of its nodes are near some of the others.
bool LiesAlong(const SpinePolygon& polygon, const SpinePolygon& other, double near_mm) {
  const auto near = std::count_if(polygon.begin(), polygon.end(), [&](const SpineNode& node) {
    return std::any_of(other.begin(), other.end(), [&](const SpineNode& there) {
      return (there.position_mm - node.position_mm).norm() < near_mm;
    });
  });
  return 2 * static_cast<std::size_t>(near) > polygon.size();
}

// The curve with what leads through its gaps; what was put there goes to `followed`, too.
SpinePolygon WithGapsFollowed(const SampleGrid& grid, double r_mm, const SpinePolygon& polygon,
                              SpinePolygon& followed) {
  SpinePolygon with;
  for (const SpineNode& node : polygon) {
    if (with.size() > 2 && (node.position_mm - with.back().position_mm).norm() > kThin.gap * r_mm) {
      const SpinePolygon between = Way(grid, r_mm, with).FollowTo(node);
      with.insert(with.end(), between.begin(), between.end());
      followed.insert(followed.end(), between.begin(), between.end());
    }
    with.push_back(node);
  }
  return with;
}

}  // namespace

void FollowThinParts(const SampleGrid& grid, double pipe_radius_mm,
                     std::vector<SpinePolygon>& polygons) {
  if (polygons.empty() || polygons.front().size() < 3) return;
  SpinePolygon followed;
  SpinePolygon longest = WithGapsFollowed(grid, pipe_radius_mm, polygons.front(), followed);
  for (int end = 0; end < 2; ++end) {
    Reverse(longest);
    const SpinePolygon beyond = Way(grid, pipe_radius_mm, longest).Follow();
    longest.insert(longest.end(), beyond.begin(), beyond.end());
    followed.insert(followed.end(), beyond.begin(), beyond.end());
  }
  if (followed.empty()) return;
  polygons.front() = std::move(longest);
  const auto rest =
      std::remove_if(polygons.begin() + 1, polygons.end(), [&](const SpinePolygon& piece) {
        return LiesAlong(piece, followed, kThin.same * pipe_radius_mm);
      });
  polygons.erase(rest, polygons.end());
}

}  // namespace bendloop::pipeline
