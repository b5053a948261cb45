// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/dent_fit.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <map>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/features/dent_form.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/product_sums.h"
#include "pipeline/math/quantiles.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

struct DentFitSettings {
  // [of its depth] and [sigma] Points further off are none of the wall's.
  double most_off = 2.5, off_sigmas = 6.0;
  // [sigma] Points that the first fit leaves so far off are left out of the second.
  double flier = 5.0;
  // Points: fewer tell no area, or not even a depth.
  std::size_t least_points = 60, least_held = 20;
  // 1 sigma before the scan: of the logarithm of the power s (balls and edges press gaussians,
  // flats have up to 3), of the tail t (1 would be 1 / (1 + q^s), 0 a gaussian, and what is less
  // ends somewhere), of the logarithm of either half axis about the cells', [of r_P] of the
  // wall's own form at the edge of what is looked at, and [of the cells'] of the depth; its place
  // is in what is looked at. They decide only where points leave it open: where no point lies on a
  // flank, none of them tells place and area.
  double power = 0.5, tail = 0.5, half_axis = 0.7, wall = 0.05, depth = 3.0;
  // The form that ends soonest falls to its edge hardly more steeply than a straight line.
  double least_tail = -1.1;
  // Of the logarithm of how far its form would go on below a flat bottom, what is expected before
  // the scan, and 1 sigma.
  double bottom = -0.4, bottom_sigma = 0.7;
  int most_steps = 40;
  int most_rounds = 4;  // in which points are taken again that may be of it, as it proves deeper
  // Of chi square: a step that makes it less by no more, a thirtieth of a sigma long, is the last.
  double hardly = 1e-3;
  // [of depth and area] 1 sigma of what a dent may be like that these forms are not.
  double of_form = 0.004;
  // [sigma] Chi square says that surely that the form is another; and [of its mean radius] points
  // of a patch so wide lie off together then.
  double unlike_sigmas = 3.0, patch = 0.5;
  // [of what it leaves beyond noise, rms] 1 sigma of its depth then.
  double of_left = 1.2;
  // [of area] 1 sigma of a dent that is known no better was not fitted.
  double vague_area = 0.5;
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
  // fitted, if they are steeper than metal is drawn: the power of a dent without a tail or a flat
  // bottom that is as steep, the tangent of its slope, and [sigma] of their logarithms.
  double step = 3.5, slope = 1.7, step_sigmas = 2.0;
};
constexpr DentFitSettings kDentFit;

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
  kBottom,
  kWall,  // of the wall: its radius, its axis aside in two directions, and how that grows along
  kUnknowns = kWall + 5
};
static_assert(kDentFit.least_held > kUnknowns);  // some are left to tell how well it fits
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
      : noise_mm_(noise_mm), off_mm_(MostOffWallMm(depth_mm, noise_mm)) {
    all_.reserve(points.size());
    for (const WallPoint& point : points) {
      const double around = point.around_mm / pipe_radius_mm;
      all_.push_back({point.along_mm, point.around_mm, point.off_mm, std::cos(around),
                      std::sin(around), point.along_mm / reach_mm});
    }
    Take();
    at_[kDepth] = depth_mm;
    at_[kAxisU] = at_[kAxisV] = -std::log(0.5 * size_mm);
    at_[kBottom] = kDentFit.bottom;
    about_ = at_;
    certainty_[kDepth] = 1.0 / (kDentFit.depth * depth_mm);
    certainty_[kU] = certainty_[kV] = 1.0 / reach_mm;
    certainty_[kAxisU] = certainty_[kAxisV] = 1.0 / kDentFit.half_axis;
    certainty_[kLean] = 0.5 * size_mm / kDentFit.half_axis;
    certainty_[kPower] = 1.0 / kDentFit.power;
    certainty_[kTail] = 1.0 / kDentFit.tail;
    certainty_[kBottom] = 1.0 / kDentFit.bottom_sigma;
    certainty_.tail<5>().setConstant(1.0 / (kDentFit.wall * pipe_radius_mm));
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
    for (const Unknown k : {kU, kV, kAxisU, kLean, kAxisV, kPower, kTail, kBottom}) {
      certainty_[k] = kHeld;
    }
    is_held_ = true;
  }

  // False: fewer points than `least` tell of it, or the fit explains too few of them.
  bool Fit(std::size_t least) {
    if (points_.size() < least) return false;
    Solve();
    // Cells have the mean of its middle and its flanks, down to a quarter of its depth: without the
    // points of its middle it would be too shallow, and too large.
    for (int round = 0; !is_held_ && round < kDentFit.most_rounds; ++round) {
      const double off_mm = MostOffWallMm(at_[kDepth], noise_mm_);
      if (!(off_mm > off_mm_)) break;
      off_mm_ = off_mm;
      Take();
      Solve();
    }
    const auto all = static_cast<double>(points_.size());
    const Shape shape(at_);
    std::erase_if(points_, [&](const DentPoint& point) {
      return std::abs(OffOf(point, shape).off_mm) > kDentFit.flier * noise_mm_;
    });
    if (points_.size() < least) return false;
    normal_ = Solve();
    return static_cast<double>(points_.size()) > kDentFit.least_kept * all;
  }

  // After Fit(); whether it is one is for others to say.
  FittedDent Dent() const {
    const double misfit =
        normal_.cost / static_cast<double>(points_.size() - std::size_t{kUnknowns});
    const double by_chance =
        kDentFit.unlike_sigmas * std::sqrt(2.0 / static_cast<double>(points_.size()));
    const double unlike = is_held_ ? 0.0 : misfit - 1.0 - by_chance;
    const Square covariance = CovarianceOf(misfit, unlike > 0);
    const auto sigma = [&](Unknown k) { return std::sqrt(covariance(k, k)); };
    FittedDent dent;
    dent.along_mm = at_[kU], dent.along_sigma_mm = sigma(kU);
    dent.around_mm = at_[kV], dent.around_sigma_mm = sigma(kV);
    dent.depth_mm = at_[kDepth];
    const double unlike_mm = kDentFit.of_left * noise_mm_ * std::sqrt(std::max(0.0, unlike));
    dent.depth_sigma_mm = std::hypot(sigma(kDepth), kDentFit.of_form * dent.depth_mm, unlike_mm);
    dent.area_mm2 = AreaOf(at_);
    dent.area_sigma_mm2 = std::hypot(SigmaOf(AreaOf, covariance), kDentFit.of_form * dent.area_mm2);
    dent.misfit = misfit;
    dent.is_step = IsStep(covariance);
    return dent;
  }

  // What is seen where it is half as deep and more: on it, no further off than `whole_mm`, above it
  // and below it. `deep`: what lies on it anywhere, pressed in by no less than a flank.
  struct Inside {
    int on = 0, above = 0, below = 0, deep = 0;
    bool MostAreNot(int other) const {
      return other <= (1.0 - kDentFit.least_whole) * (on + above + below);
    }
  };
  Inside CountInside(double whole_mm) const {
    const Shape shape(at_);
    whole_mm = std::max(whole_mm, kDentFit.flier * noise_mm_);
    Inside inside;
    for (const DentPoint& point : all_) {
      const auto [off_mm, part] = OffOf(point, shape);
      const double in_mm = at_[kDepth] * part - off_mm;
      if (std::abs(off_mm) <= whole_mm && in_mm > kDentFit.flank * at_[kDepth]) ++inside.deep;
      if (part < 0.5) continue;  // beyond where it is half as deep
      ++(off_mm > whole_mm ? inside.above : off_mm < -whole_mm ? inside.below : inside.on);
    }
    return inside;
  }

 private:
  // Where the form is not the dent's, the residuals say so: by how much, and, if they do so
  // certainly, that neighbours lie off together.
  Square CovarianceOf(double misfit, bool is_unlike) const {
    const Square inverse = Inverse(normal_.matrix);
    const Square covariance = std::max(1.0, misfit) * inverse;
    if (!is_unlike) return covariance;
    const Square robust = inverse * Scatter() * inverse;
    const Unknowns more =
        (robust.diagonal().array() / covariance.diagonal().array()).max(1.0).sqrt();
    return more.asDiagonal() * covariance * more.asDiagonal();
  }

  // Of what the numbers tell, by how it changes with each.
  double SigmaOf(double (*value)(const Unknowns&), const Square& covariance) const {
    constexpr double kStep = 1e-3;  // [sigma]
    Unknowns by;
    for (int k = 0; k < kUnknowns; ++k) {
      const double step = kStep * std::sqrt(covariance(k, k));
      Unknowns more = at_, less = at_;
      more[k] += step, less[k] -= step;
      by[k] = step > 0 ? (value(more) - value(less)) / (2.0 * step) : 0.0;
    }
    return std::sqrt(std::max(0.0, by.dot(covariance * by)));
  }

  // Of the right side, by what patches of the wall add to it: what a form leaves is alike on
  // neighbours.
  Square Scatter() const {
    const Shape shape(at_);
    const double side_mm = kDentFit.patch * std::sqrt(AreaOf(at_) / std::numbers::pi);
    const double weight = 1.0 / (noise_mm_ * noise_mm_);
    std::map<std::pair<int, int>, Unknowns> patches;
    for (const DentPoint& point : points_) {
      std::array<double, kUnknowns + 1> row;
      FindRow(point, at_, shape, [&row](int k) -> double& { return row[k]; });
      const auto place = std::pair(static_cast<int>(std::floor(point.along_mm / side_mm)),
                                   static_cast<int>(std::floor(point.around_mm / side_mm)));
      Unknowns& patch = patches.try_emplace(place, Unknowns::Zero()).first->second;
      patch += weight * row[kOff] * Eigen::Map<const Unknowns>(row.data());
    }
    Square scatter = certainty_.cwiseAbs2().asDiagonal();
    for (const auto& [place, patch] : patches) scatter += patch * patch.transpose();
    return scatter;
  }

  bool IsStep(const Square& covariance) const {
    const double surely =
        LogSteepness(at_) - kDentFit.step_sigmas * SigmaOf(LogSteepness, covariance);
    return surely > std::log(kDentFit.step) && LogSlope(at_) > std::log(kDentFit.slope);
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
  static DentForm FormOf(const Unknowns& x) {
    return DentForm({.log_power = x[kPower], .tail = x[kTail], .log_bottom = x[kBottom]});
  }
  // [mm2] Where it is half as deep and more.
  static double AreaOf(const Unknowns& x) {
    return std::numbers::pi * FormOf(x).HalfQ() * std::exp(-x[kAxisU] - x[kAxisV]);
  }
  // Of the power of a flat without a bottom whose flanks are as steep for its size and depth.
  static double LogSteepness(const Unknowns& x) {
    const DentForm form = FormOf(x);
    return std::log(-2.0 / std::numbers::ln2 * form.At(form.HalfQ()).by_log_q);
  }
  // Of the tangent of its steepest flank, where it is half as deep.
  static double LogSlope(const Unknowns& x) {
    const double u = std::exp(x[kAxisU]), v = std::exp(x[kAxisV]);
    const double half = 0.5 * (u * u + x[kLean] * x[kLean] + v * v);
    const double least_axis_mm = std::sqrt(
        FormOf(x).HalfQ() / (half + std::sqrt(std::max(0.0, half * half - u * u * v * v))));
    return LogSteepness(x) + std::log(std::numbers::ln2 * std::abs(x[kDepth]) / least_axis_mm);
  }

  // What all points have in common of the numbers.
  struct Shape {
    explicit Shape(const Unknowns& x)
        : of_u(std::exp(x[kAxisU])), of_v(std::exp(x[kAxisV])), form(FormOf(x)) {}
    double of_u, of_v;
    DentForm form;
  };

  // How far the point lies out of what the numbers say, and its derivatives to them.
  template <class Row>
  static void FindRow(const DentPoint& point, const Unknowns& x, const Shape& shape, Row row) {
    const double u = point.along_mm - x[kU], v = point.around_mm - x[kV];
    const double z_u = shape.of_u * u + x[kLean] * v, z_v = shape.of_v * v;
    const double q = std::max(1e-12, z_u * z_u + z_v * z_v);
    const DentForm::Row form = shape.form.At(q);
    const double in_mm = -x[kDepth], by_q = in_mm * form.by_log_q / q;
    row(kDepth) = -form.f;
    row(kU) = -2.0 * by_q * z_u * shape.of_u;
    row(kV) = -2.0 * by_q * (z_u * x[kLean] + z_v * shape.of_v);
    row(kAxisU) = 2.0 * by_q * z_u * shape.of_u * u;
    row(kLean) = 2.0 * by_q * z_u * v;
    row(kAxisV) = 2.0 * by_q * z_v * shape.of_v * v;
    row(kPower) = in_mm * form.by_power;
    row(kTail) = in_mm * form.by_tail;
    row(kBottom) = in_mm * form.by_bottom;
    row(kWall) = 1.0;
    row(kWall + 1) = point.cosine;
    row(kWall + 2) = point.sine;
    row(kWall + 3) = point.reach * point.cosine;
    row(kWall + 4) = point.reach * point.sine;
    const double wall = x[kWall] + (x[kWall + 1] + x[kWall + 3] * point.reach) * point.cosine +
                        (x[kWall + 2] + x[kWall + 4] * point.reach) * point.sine;
    row(kOff) = point.off_mm - (wall - x[kDepth] * form.f);
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
    for (int step = 0; step < kDentFit.most_steps && damping < 1e8; ++step) {
      Square damped = here.matrix;
      damped.diagonal() *= 1.0 + damping;
      const Unknowns to = at_ + Unknowns(SolveSymmetric(damped, here.right));
      const bool is_form = to.allFinite() && to[kTail] > kDentFit.least_tail;
      const Normal there = is_form ? NormalAt(to) : Normal{here.cost + 1.0, {}, {}};
      if (!(there.cost < here.cost)) {
        damping *= 8.0;
        continue;
      }
      const bool is_done = here.cost - there.cost < kDentFit.hardly;
      at_ = to;
      here = there;
      damping *= 0.2;
      if (is_done) break;
    }
    return here;
  }

  std::vector<DentPoint> all_, points_;
  double noise_mm_, off_mm_;
  bool is_held_ = false;
  Normal normal_;
  Unknowns at_ = Unknowns::Zero(), about_ = Unknowns::Zero(), certainty_ = Unknowns::Zero();
};

}  // namespace

double MostOffWallMm(double depth_mm, double noise_mm) {
  return kDentFit.most_off * depth_mm + kDentFit.off_sigmas * noise_mm;
}

FittedDent FitDent(std::span<const WallPoint> points, double reach_mm, double depth_mm,
                   double size_mm, double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return {};
  DentFit fit(points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm);
  if (!fit.Fit(kDentFit.least_points)) return {};
  FittedDent dent = fit.Dent();
  const DentFit::Inside inside = fit.CountInside(kDentFit.whole * dent.depth_mm);
  dent.is_fitted =
      !dent.is_step && dent.depth_sigma_mm < kVagueDepth * dent.depth_mm &&
      dent.area_sigma_mm2 < kDentFit.vague_area * dent.area_mm2 &&
      dent.depth_mm + kDentFit.denied_sigmas * dent.depth_sigma_mm > kDentFit.denied * depth_mm &&
      dent.IsWithin(reach_mm) && dent.area_mm2 < std::numbers::pi * reach_mm * reach_mm &&
      inside.deep >= kDentFit.least_deep && inside.MostAreNot(inside.above + inside.below);
  return dent;
}

bool IsShown(std::span<const WallPoint> points, double reach_mm, double depth_mm, double size_mm,
             double pipe_radius_mm, double noise_mm) {
  if (!(noise_mm > 0)) return true;
  DentFit held(points, reach_mm, depth_mm, size_mm, pipe_radius_mm, noise_mm);
  if (held.CountDeep(kDentFit.denied * depth_mm) < kDentFit.least_deep) return false;
  held.Hold();
  if (!held.Fit(kDentFit.least_held)) return false;
  const FittedDent dent = held.Dent();
  const double unsure_mm = kDentFit.denied_sigmas * dent.depth_sigma_mm;
  const DentFit::Inside inside = held.CountInside(kDentFit.whole_of_cells * depth_mm);
  return dent.depth_mm > unsure_mm && dent.depth_mm + unsure_mm > kDentFit.denied * depth_mm &&
         inside.MostAreNot(inside.below);
}

}  // namespace bendloop::pipeline
