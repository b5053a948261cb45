// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dents.h"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "hal/angles.h"
#include "hal/tube_features.h"
#include "pipeline/features/unrolled_wall.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/surface_sums.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/product_sums.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct DentSettings {
  // [of its size] and [of r_P] So far around its middle the wall is looked at, on its unrolled
  // surface.
  double look = 1.25, look_more = 0.5;
  // [of r_P] No further around the tube: beyond is its other side.
  double most_around = 2.2;
  // [of its depth] and [sigma] Points further off are none of the wall's.
  double most_off = 2.5, off_sigmas = 6.0;
  // [of r_P] Deeper ones are still asked whether the wall is whole there: through one that was
  // pressed in nothing is seen. Beyond lies the wall across.
  double most_in = 0.6;
  // [sigma] Points that the first fit leaves so far off are left out of the second.
  double flier = 5.0;
  // Points: fewer tell no area, or not even a depth; more tell hardly more and cost time.
  std::size_t least_points = 60, least_held = 20, enough_points = 4000;
  // 1 sigma before the scan: of the logarithm of the power s (balls and edges press gaussians,
  // flats have up to 3), of the tail t (1 would be 1 / (1 + q^s), 0 a gaussian, and what is less
  // ends somewhere), of the logarithm of either half axis about the cells', [of r_P] of the
  // wall's own form at the edge of what is looked at, and [of the cells'] of the depth; its place
  // is in what is looked at. They decide only where points leave it open: where no point lies on a
  // flank, none of them tells place and area.
  double power = 0.5, tail = 0.5, half_axis = 0.7, wall = 0.05, depth = 3.0;
  // The form that ends soonest falls to its edge as a straight line or less.
  double least_tail = -0.95;
  int most_steps = 40;
  int most_rounds = 4;  // in which points are taken again that may be of it, as it proves deeper
  // Of chi square: a step that makes it less by no more, a thirtieth of a sigma long, is the last.
  double hardly = 1e-3;
  // [of depth] and [of area] 1 sigma of a dent that is known no better was not fitted.
  double vague = 0.33, vague_area = 0.5;
  // Of what is looked at the fit explains no less, or it is none of this wall.
  double least_kept = 0.6;
  // Where it is half as deep and more a wall that was pressed in is all that there is: so much of
  // what is seen there lies no further from it than fliers do, or [of depth], or [of the cells'
  // depth] where its form is not known. Behind an opening and on its flanks samples lie at all
  // depths, and beside them on the wall.
  double least_whole = 0.75, whole = 0.3, whole_of_cells = 1.25;
  // [of the cells' depth] and [sigma] One that its points say is certainly no deeper than this is
  // none, nor is one that is not certainly pressed in.
  double denied = 0.5, denied_sigmas = 3.0;
  // Nor is one of which fewer points lie as deep as that, or [of depth] as flanks are: a hole right
  // there may leave no more of it.
  int least_deep = 8;
  double flank = 0.25;
  // One whose flanks are certainly steeper, where it is half as deep, than of any flat is not
  // fitted: the power of a dent without a tail that is as steep, and [sigma] of its logarithm.
  double step = 3.5, step_sigmas = 2.0;
  // [of r_P] and [sigma] One that cells do not show by themselves is so deep at least, as its
  // points have it, and so surely: cells look everywhere.
  double least_small = 0.02, small_sigmas = 7.0;
  // And what its form leaves of its points is no more than this, of chi square for each that is
  // free: what a scan or a bend makes of a wall, waves and sides that do not meet, is no dent's
  // form.
  double small_misfit = 1.3;
  // [of its size] Of a dent that is known: what is fitted no further from its middle is that dent
  // once more; what lies further than `apart` is looked at without the points where the known one
  // is deeper than so many [sigma].
  double same = 0.25, apart = 0.75, rim_sigmas = 0.3;
  // [of its depth] What cannot be fitted and is no deeper is what cells make of its flanks, and of
  // the wall opposite it.
  double echo = 0.3;
};
constexpr DentSettings kDents;

// So far off the round wall points may be of a dent and of the wall about it.
double MostOffMm(double depth_mm, double noise_mm) {
  return kDents.most_off * depth_mm + kDents.off_sigmas * noise_mm;
}

// The numbers of the fit. L = (e^kAxisU 0; kLean e^kAxisV): q = |L^T (place - middle)|^2.
enum Unknown : Eigen::Index {
  kDepth,
  kU,
  kV,
  kAxisU,
  kLean,
  kAxisV,
  kPower,
  kTail,
  kWall,  // of the wall: its radius, its axis aside in two directions, and how that grows along
  kUnknowns = kWall + 5
};
static_assert(kDents.least_held > kUnknowns);  // some are left to tell how well it fits
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
using Square = Eigen::Matrix<double, kUnknowns, kUnknowns>;

// Points side by side, for sums that take some of them at once: as many as a batch.
constexpr std::size_t kDentBatch = 64;
constexpr int kOff = kUnknowns;  // what the numbers leave, after their derivatives
using DentSums = ProductSums<kUnknowns + 1, kDentBatch>;

BENDLOOP_LOOP void AddDentRowsBody(DentSums& sums) { AddProducts(sums); }
BENDLOOP_MULTIVERSION(void, AddDentRows, (DentSums & sums), (sums))

// A point with what does not change while the numbers do.
struct DentPoint {
  double along_mm, around_mm, off_mm;
  double cosine, sine, reach;  // of its place around; its place along, of what is looked at
};

class DentFit {
 public:
  DentFit(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
          double pipe_radius_mm, double noise_mm)
      : noise_mm_(noise_mm), off_mm_(MostOffMm(depth_mm, noise_mm)) {
    all_.reserve(points.size());
    for (const WallPoint& point : points) {
      const double around = point.around_mm / pipe_radius_mm;
      all_.push_back({point.along_mm, point.around_mm, point.off_mm, std::cos(around),
                      std::sin(around), point.along_mm / reach_mm});
    }
    Take();
    at_[kDepth] = depth_mm;
    at_[kAxisU] = at_[kAxisV] = -std::log(0.5 * size_mm);
    about_ = at_;
    certainty_[kDepth] = 1.0 / (kDents.depth * depth_mm);
    certainty_[kU] = certainty_[kV] = 1.0 / reach_mm;
    certainty_[kAxisU] = certainty_[kAxisV] = 1.0 / kDents.half_axis;
    certainty_[kLean] = 0.5 * size_mm / kDents.half_axis;
    certainty_[kPower] = 1.0 / kDents.power;
    certainty_[kTail] = 1.0 / kDents.tail;
    certainty_.tail<5>().setConstant(1.0 / (kDents.wall * pipe_radius_mm));
  }

  // How many points lie so deep below what is usual.
  int CountDeep(double deep_mm) const {
    std::vector<double> off_mm;
    for (const DentPoint& point : points_) off_mm.push_back(point.off_mm);
    if (off_mm.empty()) return 0;
    const double usual_mm = Median(off_mm);
    return static_cast<int>(std::count_if(off_mm.begin(), off_mm.end(),
                                          [&](double off) { return usual_mm - off > deep_mm; }));
  }

  // The same place, size and form, whatever the points say.
  void Hold() {
    constexpr double kHeld = 1e6;  // [1 / mm, and of what has no unit]
    for (const Unknown k : {kU, kV, kAxisU, kLean, kAxisV, kPower, kTail}) certainty_[k] = kHeld;
    rounds_ = 0;
  }

  // False: fewer points than `least` tell of it, or the fit explains too few of them.
  bool Fit(std::size_t least) {
    if (points_.size() < least) return false;
    Solve();
    // Cells have the mean of its middle and its flanks, down to a quarter of its depth: without the
    // points of its middle it would be too shallow, and too large.
    for (int round = 0; round < rounds_; ++round) {
      const double off_mm = MostOffMm(at_[kDepth], noise_mm_);
      if (!(off_mm > off_mm_)) break;
      off_mm_ = off_mm;
      Take();
      Solve();
    }
    const auto all = static_cast<double>(points_.size());
    const Shape shape(at_);
    std::erase_if(points_, [&](const DentPoint& point) {
      return std::abs(OffOf(point, shape).off_mm) > kDents.flier * noise_mm_;
    });
    if (points_.size() < least) return false;
    normal_ = Solve();
    return static_cast<double>(points_.size()) > kDents.least_kept * all;
  }

  // After Fit(); whether it is one is for others to say.
  FittedDent Dent() const {
    // Where the form is not the dent's, the residuals say so.
    const double misfit =
        normal_.cost / static_cast<double>(points_.size() - std::size_t{kUnknowns});
    const Square covariance = std::max(1.0, misfit) * Inverse(normal_.matrix);
    const auto sigma = [&](Unknown k) { return std::sqrt(covariance(k, k)); };
    FittedDent dent;
    dent.along_mm = at_[kU], dent.along_sigma_mm = sigma(kU);
    dent.around_mm = at_[kV], dent.around_sigma_mm = sigma(kV);
    dent.depth_mm = at_[kDepth], dent.depth_sigma_mm = sigma(kDepth);
    dent.area_mm2 = std::numbers::pi * std::exp(-at_[kAxisU] - at_[kAxisV]);
    const double variance =
        covariance(kAxisU, kAxisU) + covariance(kAxisV, kAxisV) + 2.0 * covariance(kAxisU, kAxisV);
    dent.area_sigma_mm2 = dent.area_mm2 * std::sqrt(variance);
    dent.misfit = misfit;
    dent.is_step = IsStep(covariance);
    return dent;
  }

  // What is seen where it is half as deep and more: on it, no further off than `whole_mm`, above it
  // and below it. `deep`: what lies on it anywhere, pressed in by no less than a flank.
  struct Inside {
    int on = 0, above = 0, below = 0, deep = 0;
    bool MostAreNot(int other) const {
      return other <= (1.0 - kDents.least_whole) * (on + above + below);
    }
  };
  Inside CountInside(double whole_mm) const {
    const Shape shape(at_);
    whole_mm = std::max(whole_mm, kDents.flier * noise_mm_);
    Inside inside;
    for (const DentPoint& point : all_) {
      const auto [off_mm, part] = OffOf(point, shape);
      const double in_mm = at_[kDepth] * part - off_mm;
      if (std::abs(off_mm) <= whole_mm && in_mm > kDents.flank * at_[kDepth]) ++inside.deep;
      if (part < 0.5) continue;  // beyond where it is half as deep
      ++(off_mm > whole_mm ? inside.above : off_mm < -whole_mm ? inside.below : inside.on);
    }
    return inside;
  }

 private:
  bool IsStep(const Square& covariance) const {
    const Shape shape(at_);
    const double unit = shape.tail * std::numbers::ln2;
    const double log_steep = at_[kPower] + std::log(-std::expm1(-unit) / unit);
    const double by_tail = std::numbers::ln2 * (1.0 / std::expm1(unit) - 1.0 / unit);
    const double variance = covariance(kPower, kPower) + 2.0 * by_tail * covariance(kPower, kTail) +
                            by_tail * by_tail * covariance(kTail, kTail);
    return log_steep - kDents.step_sigmas * std::sqrt(std::max(0.0, variance)) >
           std::log(kDents.step);
  }

  // The points that may be of the dent or of the wall about it.
  void Take() {
    points_.clear();
    std::copy_if(all_.begin(), all_.end(), std::back_inserter(points_),
                 [this](const DentPoint& point) { return std::abs(point.off_mm) <= off_mm_; });
  }

  // Sum of squares in sigmas, and the normal equations.
  struct Normal {
    double cost = 0;
    Square matrix;
    Unknowns right;
  };
  // What all points have in common of the numbers.
  struct Shape {
    explicit Shape(const Unknowns& x)
        : of_u(std::exp(x[kAxisU])),
          of_v(std::exp(x[kAxisV])),
          power(std::exp(x[kPower])),
          tail(std::copysign(std::max(kLeastTail, std::abs(x[kTail])), x[kTail])),
          twofold(std::expm1(std::numbers::ln2 * tail)) {}
    static constexpr double kLeastTail = 1e-4;  // as good as none, and no division by it
    double of_u, of_v, power, tail;
    double twofold;  // 2^tail - 1
  };

  // How far the point lies out of what the numbers say, and its derivatives to them.
  template <class Row>
  static void FindRow(const DentPoint& point, const Unknowns& x, const Shape& shape, Row row) {
    const double u = point.along_mm - x[kU], v = point.around_mm - x[kV];
    const double z_u = shape.of_u * u + x[kLean] * v, z_v = shape.of_v * v;
    const double q = std::max(1e-12, z_u * z_u + z_v * z_v);
    const double log_q = std::log(q);
    constexpr double kMost = 600.0;  // beyond, of the logarithm, g would be infinite
    const double g = std::exp(std::min(kMost, shape.power * log_q));
    // Beyond where a dent with a tail below nothing ends, all of it is as good as nothing.
    constexpr double kEnd = 1e-12 - 1.0;
    const double rises = std::max(kEnd, shape.twofold * g), log_rises = std::log1p(rises);
    const double f = rises > kEnd ? std::exp(-log_rises / shape.tail) : 0.0;
    const double share = rises / (1.0 + rises);
    const double by_q = x[kDepth] * f * share * shape.power / (shape.tail * q);
    row(kDepth) = -f;
    row(kU) = -2.0 * by_q * z_u * shape.of_u;
    row(kV) = -2.0 * by_q * (z_u * x[kLean] + z_v * shape.of_v);
    row(kAxisU) = 2.0 * by_q * z_u * shape.of_u * u;
    row(kLean) = 2.0 * by_q * z_u * v;
    row(kAxisV) = 2.0 * by_q * z_v * shape.of_v * v;
    row(kPower) = by_q * q * log_q;
    row(kTail) = -x[kDepth] * f *
                 (log_rises / shape.tail -
                  share * (1.0 + shape.twofold) / shape.twofold * std::numbers::ln2) /
                 shape.tail;
    row(kWall) = 1.0;
    row(kWall + 1) = point.cosine;
    row(kWall + 2) = point.sine;
    row(kWall + 3) = point.reach * point.cosine;
    row(kWall + 4) = point.reach * point.sine;
    const double wall = x[kWall] + (x[kWall + 1] + x[kWall + 3] * point.reach) * point.cosine +
                        (x[kWall + 2] + x[kWall + 4] * point.reach) * point.sine;
    row(kOff) = point.off_mm - (wall - x[kDepth] * f);
  }

  struct Off {
    double off_mm, part;  // of the depth, that the dent has there
  };
  Off OffOf(const DentPoint& point, const Shape& shape) const {
    std::array<double, kUnknowns + 1> row;
    FindRow(point, at_, shape, [&row](int k) -> double& { return row[k]; });
    return {row[kOff], -row[kDepth]};
  }

  Normal NormalAt(const Unknowns& x) const {
    const Shape shape(x);
    DentSums sums;
    for (std::size_t first = 0; first < points_.size(); first += kDentBatch) {
      const std::size_t count = std::min(kDentBatch, points_.size() - first);
      for (std::size_t l = 0; l < kDentBatch; ++l) {
        sums.weight[l] = l < count ? 1.0 : 0.0;
        // What fills the last batch has no weight; any point will do.
        const DentPoint& point = points_[l < count ? first + l : first];
        FindRow(point, x, shape, [&sums, l](int k) -> double& { return sums.functions[k][l]; });
      }
      AddDentRows(sums);
    }
    const double weight = 1.0 / (noise_mm_ * noise_mm_);
    Normal normal;
    normal.cost =
        (x - about_).cwiseProduct(certainty_).squaredNorm() + weight * sums.sum[kOff][kOff];
    normal.right = certainty_.cwiseAbs2().cwiseProduct(about_ - x);
    for (int k = 0; k < kUnknowns; ++k) {
      normal.right[k] += weight * sums.sum[kOff][k];
      for (int i = k; i < kUnknowns; ++i) {
        normal.matrix(i, k) = normal.matrix(k, i) = weight * sums.sum[i][k];
      }
    }
    normal.matrix.diagonal() += certainty_.cwiseAbs2();
    return normal;
  }

  // Levenberg and Marquardt, to `at_`. The equations are summed with the cost, as most steps lead
  // on. Returns those of where it came to.
  Normal Solve() {
    Normal here = NormalAt(at_);
    double damping = 1e-3;
    for (int step = 0; step < kDents.most_steps && damping < 1e8; ++step) {
      Square damped = here.matrix;
      damped.diagonal() *= 1.0 + damping;
      const Unknowns to = at_ + Unknowns(SolveSymmetric(damped, here.right));
      const bool is_form = to.allFinite() && to[kTail] > kDents.least_tail;
      const Normal there = is_form ? NormalAt(to) : Normal{here.cost + 1.0, {}, {}};
      if (!(there.cost < here.cost)) {
        damping *= 8.0;
        continue;
      }
      const bool is_done = here.cost - there.cost < kDents.hardly;
      at_ = to;
      here = there;
      damping *= 0.2;
      if (is_done) break;
    }
    return here;
  }

  std::vector<DentPoint> all_, points_;
  double noise_mm_, off_mm_;
  int rounds_ = kDents.most_rounds;
  Normal normal_;
  Unknowns at_ = Unknowns::Zero(), about_ = Unknowns::Zero(), certainty_ = Unknowns::Zero();
};

// A circle on the wall that a dent that is known reaches to.
struct DentCircle {
  Eigen::Vector3d middle_mm;
  double radius_mm;
};

// The wall about a place, unrolled.
class Wall {
 public:
  Wall(const hal::Tube& tube, const WallForm& form, const CutFaces& faces, double noise_mm,
       std::span<const PointBlock> blocks)
      : r_mm_(tube.pipe_radius_mm),
        faces_(faces),
        face_mm_(CutFaces::ReachMm(noise_mm, r_mm_)),
        spine_(SpineOf(tube.program, tube.X_WT, form.easing)),
        frames_(SegmentFrames(spine_, 0.0, form.flattening)),
        blocks_(blocks) {
    for (const Flattening& of_bend : form.flattening) {
      const double most =
          0.5 * (std::abs(of_bend.constant) + std::abs(of_bend.bump)) + std::abs(of_bend.collapse);
      flat_mm_ = std::max(flat_mm_, most * r_mm_);
    }
  }

  // The nearest to a point, outwards to it, and where along the spine.
  std::pair<hal::SurfaceFrame, double> FrameTo(const Eigen::Vector3d& point) const {
    const SpineFoot foot = FootOf(point);
    const double along_mm =
        foot.segment < 0
            ? 0.0
            : spine_.segments[static_cast<std::size_t>(foot.segment)].from_start_mm + foot.along_mm;
    hal::SurfaceFrame frame = FrameAt(along_mm, 0.0);
    const Eigen::Vector3d out = point - frame.spine_mm;
    frame.outward = (out - out.dot(frame.tangent) * frame.tangent).normalized();
    return {frame, along_mm};
  }

  // At most `enough_points`, as far apart as all of them; off the wall that is flattened; without
  // those in `others`, as far as these are no nearer than `own_mm`.
  std::vector<WallPoint> About(const hal::SurfaceFrame& frame, double along_mm, double reach_mm,
                               double off_mm, std::span<const DentCircle> others,
                               double own_mm) const {
    const double in_mm = std::max(off_mm, kDents.most_in * r_mm_);
    std::vector<SeenPoint> seen =
        SeenAbout(frame, along_mm, reach_mm, {-in_mm - flat_mm_, off_mm + flat_mm_});
    const UnrolledWall unrolled(spine_.segments, frame, r_mm_);
    for (const DentCircle& other : others) {
      const auto middle = PlaceOf(other.middle_mm, unrolled, along_mm);
      if (!middle) continue;
      const double radius_mm =
          std::min(other.radius_mm, std::hypot(middle->along_mm, middle->around_mm) - own_mm);
      std::erase_if(seen, [&](const SeenPoint& point) {
        const double around_mm = std::remainder(point.place.around_mm - middle->around_mm,
                                                2.0 * std::numbers::pi * r_mm_);
        return std::hypot(point.place.along_mm - middle->along_mm, around_mm) < radius_mm;
      });
    }
    const std::size_t stride = StrideTo(seen.size(), kDents.enough_points);
    std::vector<WallPoint> points;
    for (std::size_t i = 0; i < seen.size(); i += stride) {
      WallPoint point = seen[i].place;
      point.off_mm += InsideMm(*seen[i].point, seen[i].segment);
      if (point.off_mm <= off_mm && point.off_mm >= -in_mm) points.push_back(point);
    }
    return points;
  }

  hal::SurfaceFrame FrameAt(double along_mm, double around_deg) const {
    return hal::FrameAt(spine_.segments, along_mm, around_deg, spine_.pieces);
  }
  double length_mm() const { return spine_.length_mm(); }

 private:
  SpineFoot FootOf(const Eigen::Vector3d& point) const {
    std::vector<std::int32_t> all(spine_.segments.size());
    std::iota(all.begin(), all.end(), 0);
    return NearestFoot(point, spine_.segments, frames_, all);
  }
  std::optional<WallPoint> PlaceOf(const Eigen::Vector3d& point, const UnrolledWall& unrolled,
                                   double along_mm) const {
    const SpineFoot foot = FootOf(point);
    if (foot.segment < 0) return std::nullopt;
    const auto at = static_cast<std::size_t>(foot.segment);
    return WallPoint{spine_.segments[at].from_start_mm + foot.along_mm - along_mm,
                     -unrolled.PlaceOf(point, foot).y(), 0};
  }
  struct SeenPoint {
    WallPoint place;  // off the round wall
    const Eigen::Vector3d* point;
    std::size_t segment;
  };
  std::vector<SeenPoint> SeenAbout(const hal::SurfaceFrame& frame, double along_mm, double reach_mm,
                                   const std::array<double, 2>& off_mm) const {
    const Eigen::Vector3d middle = frame.spine_mm + r_mm_ * frame.outward;
    const auto& segments = spine_.segments;
    const UnrolledWall unrolled(segments, frame, r_mm_);
    const double around_mm = std::min(reach_mm, kDents.most_around * r_mm_);
    std::vector<SeenPoint> seen;
    std::vector<std::int32_t> candidates;
    for (const PointBlock& block : blocks_) {
      const double near_mm = std::hypot(reach_mm, around_mm) + r_mm_ + block.half_diagonal_mm;
      if ((block.center_mm - middle).squaredNorm() > near_mm * near_mm) continue;
      CandidateSegments(block, frames_, 2.0 * r_mm_, candidates);
      if (candidates.empty()) continue;
      for (const Eigen::Vector3d& point : block.points) {
        const SpineFoot foot = NearestFoot(point, segments, frames_, candidates);
        const double off = foot.distance_mm - r_mm_;
        if (foot.segment < 0 || off < off_mm[0] || off > off_mm[1]) continue;
        const auto at = static_cast<std::size_t>(foot.segment);
        const double u = segments[at].from_start_mm + foot.along_mm - along_mm;
        if (std::abs(u) > reach_mm || foot.along_mm < 0 || foot.along_mm > segments[at].length_mm)
          continue;
        const double v = -unrolled.PlaceOf(point, foot).y();
        if (std::abs(v) > around_mm || faces_.AreAt(point, face_mm_)) continue;
        seen.push_back({{u, v, off}, &point, at});
      }
    }
    return seen;
  }
  // How far the flattened wall lies inside the round one there.
  double InsideMm(const Eigen::Vector3d& point, std::size_t segment) const {
    const SegmentFrame& frame = frames_[segment];
    if (!frame.flattening) return 0.0;
    PointLanes lanes;
    lanes.x[0] = point.x(), lanes.y[0] = point.y(), lanes.z[0] = point.z();
    LocalLanes local;
    ToSegment(frame, lanes, 1, local);
    std::array<double, kBatch> inside_mm{};
    FlattenedBy(frame, r_mm_, local, inside_mm);
    return inside_mm[0];
  }

  double r_mm_;
  const CutFaces& faces_;
  double face_mm_;
  double flat_mm_ = 0;  // the furthest that a bend's wall lies off the round one
  EasedSpine spine_;
  std::vector<SegmentFrame> frames_;
  std::span<const PointBlock> blocks_;
};

// Along and around the tube of sharp bends, as its drawing has places.
class PlacesOfTube {
 public:
  explicit PlacesOfTube(const hal::Tube& tube)
      : segments_(hal::SpineSegments(tube.program, tube.X_WT)),
        frames_(SegmentFrames(segments_, 0.0)),
        all_(segments_.size()) {
    std::iota(all_.begin(), all_.end(), 0);
  }
  // By the dent's position.
  void Name(DentFound& dent) const {
    const SpineFoot foot = NearestFoot(dent.position_mm, segments_, frames_, all_);
    if (foot.segment < 0) return;
    const auto at = static_cast<std::size_t>(foot.segment);
    const hal::SpineSegment& segment = segments_[at];
    const double along_mm = std::clamp(foot.along_mm, 0.0, segment.length_mm);
    const Eigen::Vector3d tangent = segment.TangentAt(along_mm);
    const Eigen::Vector3d out = dent.position_mm - segment.PointAt(along_mm);
    dent.along_mm = segment.from_start_mm + along_mm;
    dent.around_deg = hal::AroundDeg(hal::AroundZero(segments_, at), tangent,
                                     (out - out.dot(tangent) * tangent).normalized());
  }

 private:
  std::vector<hal::SpineSegment> segments_;
  std::vector<SegmentFrame> frames_;
  std::vector<std::int32_t> all_;
};

// As the cells saw it: its middle and size to about a cell; they may have seen its flank alone, so
// its depth to about itself.
void Doubt(double pipe_radius_mm, DentFound& dent) {
  constexpr double kCellPart = 0.15;  // of r_P: 1 sigma of a place in a cell half as long
  dent.along_sigma_mm = kCellPart * pipe_radius_mm;
  dent.around_sigma_deg = kCellPart * hal::kDegreesPerRadian;
  dent.area_mm2 = 0.25 * std::numbers::pi * dent.size_mm * dent.size_mm;
  dent.area_sigma_mm2 = 0.5 * dent.area_mm2;
  dent.sigma_mm = dent.depth_mm;
}

// Whether it was fitted, and not left as the cells have it.
bool IsFitted(const DentFound& dent) { return dent.sigma_mm < kDents.vague * dent.depth_mm; }

// How far from its middle the dent is deeper than `rim_mm`, as a gaussian is.
double ReachOf(const DentFound& dent, double rim_mm) {
  return 0.5 * dent.size_mm * std::sqrt(std::log2(std::max(2.0, dent.depth_mm / rim_mm)));
}

// Whether it is one of `known` once more.
bool IsKnown(const DentFound& dent, std::span<const DentFound> known) {
  return std::any_of(known.begin(), known.end(), [&](const DentFound& other) {
    const double apart_mm = (dent.position_mm - other.position_mm).norm();
    return IsFitted(other) && apart_mm < kDents.same * std::max(dent.size_mm, other.size_mm);
  });
}

// Whether it, which could not be fitted, is what one of `known` looks like from beside it.
bool IsEcho(const DentFound& dent, const Eigen::Vector3d& tangent, double r_mm, double noise_mm,
            std::span<const DentFound> known) {
  return std::any_of(known.begin(), known.end(), [&](const DentFound& other) {
    if (!IsFitted(other) || dent.depth_mm > kDents.echo * other.depth_mm) return false;
    const double reach_mm = ReachOf(other, kDents.rim_sigmas * noise_mm) + 0.5 * dent.size_mm;
    const Eigen::Vector3d apart_mm = dent.position_mm - other.position_mm;
    return std::abs(apart_mm.dot(tangent)) < reach_mm && apart_mm.norm() < reach_mm + 2.0 * r_mm;
  });
}

// What a fit that is about this dent, though its points do not tell it by themselves, leaves open
// beyond what cells make of it.
double UnsureDepthMm(const DentFound& dent, const FittedDent& fitted, double reach_mm,
                     double pipe_radius_mm) {
  const double unsure_mm = std::hypot(fitted.depth_sigma_mm, fitted.depth_mm - dent.depth_mm);
  const bool is_of_it = fitted.depth_sigma_mm > 0 && !fitted.is_step && fitted.IsWithin(reach_mm);
  if (!is_of_it || !std::isfinite(unsure_mm)) return dent.sigma_mm;
  return std::max(dent.sigma_mm, std::min(unsure_mm, pipe_radius_mm));
}

// Whether its points show it, where cells by themselves do not.
bool IsSureSmall(const FittedDent& fitted, double pipe_radius_mm) {
  return fitted.misfit < kDents.small_misfit &&
         fitted.depth_mm > kDents.least_small * pipe_radius_mm &&
         fitted.depth_mm > kDents.small_sigmas * fitted.depth_sigma_mm;
}

// From the points about it. False: there is none, or it is one of `known`.
bool MeasureDent(const Wall& wall, double r_mm, double noise_mm, std::span<const DentFound> known,
                 DentFound& dent) {
  Doubt(r_mm, dent);
  const bool in_cells = dent.depth_mm > kDentInCells * r_mm;
  std::vector<DentCircle> others;
  for (const DentFound& other : known) {
    const bool is_apart = (dent.position_mm - other.position_mm).norm() >
                          kDents.apart * std::max(dent.size_mm, other.size_mm);
    if (IsFitted(other) && is_apart) {
      others.push_back({other.position_mm, ReachOf(other, kDents.rim_sigmas * noise_mm)});
    }
  }
  const auto [frame, middle_mm] = wall.FrameTo(dent.position_mm);
  const double reach_mm = kDents.look * dent.size_mm + kDents.look_more * r_mm;
  const std::vector<WallPoint> points = wall.About(
      frame, middle_mm, reach_mm, MostOffMm(dent.depth_mm, noise_mm), others, 0.5 * dent.size_mm);
  const FittedDent fitted = FitDent(points, reach_mm, dent.depth_mm, dent.size_mm, r_mm, noise_mm);
  if (!fitted.is_fitted) {
    dent.sigma_mm = UnsureDepthMm(dent, fitted, reach_mm, r_mm);
    return in_cells && IsShown(points, reach_mm, dent.depth_mm, dent.size_mm, r_mm, noise_mm) &&
           !IsKnown(dent, known) && !IsEcho(dent, frame.tangent, r_mm, noise_mm, known);
  }
  if (!in_cells && !IsSureSmall(fitted, r_mm)) return false;
  const double along_mm = std::clamp(middle_mm + fitted.along_mm, 0.0, wall.length_mm());
  const hal::SurfaceFrame there = wall.FrameAt(along_mm, 0.0);
  const Eigen::Vector3d outward = UnrolledWall::Carried(
      Eigen::AngleAxisd(fitted.around_mm / r_mm, frame.tangent) * frame.outward, frame.tangent,
      there.tangent);
  dent.position_mm = there.spine_mm + r_mm * outward;
  dent.along_sigma_mm = fitted.along_sigma_mm;
  dent.around_sigma_deg = fitted.around_sigma_mm / r_mm * hal::kDegreesPerRadian;
  dent.depth_mm = fitted.depth_mm, dent.sigma_mm = fitted.depth_sigma_mm;
  dent.area_mm2 = fitted.area_mm2, dent.area_sigma_mm2 = fitted.area_sigma_mm2;
  dent.size_mm = 2.0 * std::sqrt(fitted.area_mm2 / std::numbers::pi);
  return !IsKnown(dent, known);
}

}  // namespace

FittedDent FitDent(std::span<const WallPoint> points, double reach_mm, double depth_mm,
                   double size_mm, double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return {};
  DentFit fit(points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm);
  if (!fit.Fit(kDents.least_points)) return {};
  FittedDent dent = fit.Dent();
  const DentFit::Inside inside = fit.CountInside(kDents.whole * dent.depth_mm);
  dent.is_fitted =
      !dent.is_step && dent.depth_sigma_mm < kDents.vague * dent.depth_mm &&
      dent.area_sigma_mm2 < kDents.vague_area * dent.area_mm2 &&
      dent.depth_mm + kDents.denied_sigmas * dent.depth_sigma_mm > kDents.denied * depth_mm &&
      dent.IsWithin(reach_mm) && dent.area_mm2 < std::numbers::pi * reach_mm * reach_mm &&
      inside.deep >= kDents.least_deep && inside.MostAreNot(inside.above + inside.below);
  return dent;
}

bool IsShown(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return true;
  DentFit held(points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm);
  if (held.CountDeep(kDents.denied * depth_mm) < kDents.least_deep) return false;
  held.Hold();
  if (!held.Fit(kDents.least_held)) return false;
  const FittedDent dent = held.Dent();
  const double unsure_mm = kDents.denied_sigmas * dent.depth_sigma_mm;
  const DentFit::Inside inside = held.CountInside(kDents.whole_of_cells * depth_mm);
  return dent.depth_mm > unsure_mm && dent.depth_mm + unsure_mm > kDents.denied * depth_mm &&
         inside.MostAreNot(inside.below);
}

void MeasureDents(const hal::Tube& tube, const WallForm& form, const TubeEnds& ends,
                  const CutFaces& faces, double noise_mm, std::span<const PointBlock> blocks,
                  std::vector<DentFound>& dents) {
  if (dents.empty()) return;
  const double length_mm = hal::SpineLength(tube.program);
  const Wall wall(tube, form, faces, noise_mm, blocks);
  const PlacesOfTube places(tube);
  // The deepest first: cells may have parted it, and taken the wall opposite it for pressed in.
  const auto is_deeper = [](const DentFound& a, const DentFound& b) {
    return a.depth_mm > b.depth_mm;
  };
  std::stable_sort(dents.begin(), dents.end(), is_deeper);
  std::vector<DentFound> known;
  for (DentFound dent : dents) {
    if (!MeasureDent(wall, tube.pipe_radius_mm, noise_mm, known, dent)) continue;
    places.Name(dent);
    const bool from_end = 2.0 * dent.along_mm > length_mm;
    dent.along_sigma_mm =
        std::hypot(dent.along_sigma_mm, from_end ? ends.last_sigma_mm : ends.first_sigma_mm);
    // What could not be fitted and was deeper in cells may have been this one.
    if (IsFitted(dent)) {
      std::erase_if(known, [&](const DentFound& other) {
        return !IsFitted(other) && IsKnown(other, std::span(&dent, 1));
      });
    }
    known.push_back(dent);
  }
  std::stable_sort(known.begin(), known.end(), is_deeper);
  dents = std::move(known);
}

}  // namespace bendloop::pipeline
