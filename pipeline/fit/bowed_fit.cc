// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_fit.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/cross_matrix.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct BowedSettings {
  // So many points tell whether there is anything; so many more do it then.
  std::size_t few_points = 20'000, enough_points = 200'000;
  // [of r_P] Of a place along the spine.
  double place = 1.5;
  // [of r_P] Shorter straights have no bow.
  double shortest = 2.5;
  // [of a straight's length] 1 sigma of a bow's height, and of one that changes sides: L / 300 is
  // the worst that is sold as straight.
  double bow = 0.002, s_bow = 0.001;
  // [of the highest bow] Beside the noise, for the weights: what bows leave is no outlier.
  double wide = 0.3;
  // 1 sigma of the kernel's reach, bend by bend about the tube's.
  double shape = 0.15;
  // [sigma] From which on samples insist.
  double insist = 6.0;
  // [of a straight] Its ends, which belong to the bends, are in no best-fit line.
  double beside_bend = 0.125;
  // Of a place's information that is taken away with it: 1 is a jackknife, which overdoes where a
  // place alone tells of a number; and [standard deviations] of what noise pulls, which is not
  // counted.
  double leverage = 0.5, noise_sigmas = 2.0;
  // The tube's straights lie as near to the best-fit lines: [times the highest bow], [of r_P].
  double near_bows = 6.0, near = 0.1;
  int rounds = 2, steps = 3;
  // [degrees] Bends that have a corner.
  double least_deg = 0.3, most_deg = 160;
};
constexpr BowedSettings kBowed;

constexpr double kHeld = 1e-9;  // 1 sigma of a number that stays 0

LocalMatrix InformationOf(const CondensedSum& sum) {
  return sum.topLeftCorner<kLocalState, kLocalState>();
}
LocalVector PullOf(const CondensedSum& sum) { return sum.col(kLocalState).head<kLocalState>(); }

struct Line {
  Eigen::Vector3d point, direction;
};

// The tube's parameters and, straight by straight, four numbers of its bow.
class BowedTube {
 public:
  BowedTube(const SurfaceFit& fit, const SurfaceFitOptions& options)
      : fit_(fit),
        options_(options),
        parameters_(fit.tube, options.free_pipe_radius, fit.flattening, fit.easing),
        r_mm_(fit.tube.pipe_radius_mm),
        spine_(SpineOf(fit.tube.program, fit.tube.X_WT, fit.easing)),
        frames_(SegmentFrames(spine_, kBeyond * r_mm_, fit.flattening)),
        own_(spine_.segments.size(), -1) {
    int next = parameters_.size();
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (!spine_.is_line(k) || spine_.segments[k].length_mm < kBowed.shortest * r_mm_) continue;
      own_[k] = next;
      next += kBowModes;
    }
    first_shape_ = next;
    if (parameters_.eased()) next += static_cast<int>(parameters_.bends());
    size_ = next;
    SetMotions();
    SetShapes();
  }

  // `wide_mm`: distances that bows make, for the weights.
  void Take(std::span<const PointBlock> blocks, double wide_mm) {
    const double sigma_mm = std::hypot(fit_.sigma_mm, wide_mm);
    places_ = SumPlaces(spine_, frames_, r_mm_, kBowed.place * r_mm_, blocks, options_.reach_mm,
                        sigma_mm);
    SetNoise();
    worth_ = {1.0, 1.0};
  }

  // `with_bows`: or as if all straights were straight.
  void Solve(bool with_bows) {
    for (int i = 0; i < kBowed.steps; ++i) {
      Assemble(with_bows);
      const Eigen::VectorXd range = Ranges();
      Eigen::MatrixXd informed = matrix_;
      for (int k = 0; k < size_; ++k) {
        if (std::isfinite(range[k])) informed(k, k) += noise_mm2_ / (range[k] * range[k]);
        if (!(informed(k, k) > 0)) informed(k, k) = 1.0;
      }
      const Eigen::VectorXd scale = informed.diagonal().cwiseSqrt().cwiseInverse();
      informed = scale.asDiagonal() * informed * scale.asDiagonal();
      inverse_ = scale.asDiagonal() *
                 SolveSymmetric(informed, Eigen::MatrixXd::Identity(size_, size_)) *
                 scale.asDiagonal();
      step_ = inverse_ * right_;
      SetWorth();
    }
  }

  // How far straights lie off their lines, at most [mm].
  double HighestBow() const {
    double most_mm = 0;
    for (const int own : own_) {
      if (own >= 0)
        most_mm = std::max(most_mm, step_.segment<kBowModes>(own).cwiseAbs().maxCoeff());
    }
    return most_mm;
  }
  std::size_t bows() const {
    return static_cast<std::size_t>(
        std::count_if(own_.begin(), own_.end(), [](int own) { return own >= 0; }));
  }
  // What the step explains [variances].
  double Gain() const { return step_.dot(right_) / noise_mm2_; }
  // How much less samples are worth than independent ones: of straights and bends.
  const std::array<double, 2>& worth() const { return worth_; }

  // From the step: parameters of the tube whose straights are best-fit lines. False: there is none
  // near them, as where a slight bend has no corner.
  bool MoveTo(SurfaceFit& fit) const {
    const Eigen::MatrixXd map = TradeMap();
    const Eigen::VectorXd to = TradeAt(step_);
    SurfaceFit moved = fit;
    moved.tube = parameters_.TubeAt(to);
    if (FarthestEndMm(moved.tube) > kBowed.near_bows * HighestBow() + kBowed.near * r_mm_) {
      return false;
    }
    moved.flattening = parameters_.FlatteningAt(to);
    moved.easing = parameters_.EasingAt(to);
    moved.last_start = derivatives_.back().row(0);
    SetCovariance(Mapped(map, noise_mm2_ * inverse_ + Disagreement()), options_.free_pipe_radius,
                  moved);
    fit = std::move(moved);
    return true;
  }

  // The tube stays; what places disagree by makes it less certain, and where it would rather be.
  void Doubt(bool would_move, SurfaceFit& fit) const {
    const int n = parameters_.size();
    Eigen::MatrixXd covariance = fit.covariance + Disagreement().topLeftCorner(n, n);
    const Eigen::VectorXd aside = step_.head(n);
    if (would_move) covariance += aside * aside.transpose();
    SetCovariance(std::move(covariance), options_.free_pipe_radius, fit);
  }

 private:
  // Of every segment's frame by all numbers; a straight's own bow moves its places one by one.
  void SetMotions() {
    derivatives_ = parameters_.FrameDerivatives(spine_);
    const auto& segments = spine_.segments;
    motions_.assign(segments.size(), Eigen::MatrixXd::Zero(kLocalState, size_));
    for (std::size_t k = 0; k < segments.size(); ++k) {
      motions_[k].leftCols(parameters_.size()) = derivatives_[k];
    }
    for (std::size_t j = 0; j < segments.size(); ++j) {
      if (own_[j] < 0) continue;
      // As the motion of its frame, which all behind it follow.
      const BowMotion end =
          BowMotionOf(BowShapesAt(1.0), segments[j].length_mm, segments[j].length_mm);
      const Eigen::Matrix3d axes = segments[j].axes();
      const Eigen::Matrix<double, 3, kBowModes> velocity = axes * end.topRows<3>(),
                                                turn = axes * end.middleRows<3>(3);
      for (std::size_t k = j + 1; k < segments.size(); ++k) {
        const Eigen::Matrix3d to_local = segments[k].axes().transpose();
        const Eigen::Matrix3d arm = CrossMatrix(segments[k].start_mm - segments[j].start_mm);
        motions_[k].block<3, kBowModes>(0, own_[j]) = to_local * (velocity - arm * turn);
        motions_[k].block<3, kBowModes>(3, own_[j]) = to_local * turn;
      }
    }
  }

  // Of every bend its own kernel beside the tube's: what moves its pieces moves nothing behind
  // them.
  void SetShapes() {
    for (std::size_t k = 0; k < motions_.size(); ++k) {
      if (!parameters_.eased() || spine_.is_line(k)) continue;
      motions_[k].col(first_shape_ + static_cast<int>(spine_.row(k))) =
          derivatives_[k].col(parameters_.easing_reach());
    }
  }

  BowMotion OwnMotion(const PlaceSum& place) const {
    const double length_mm = spine_.segments[place.segment].length_mm;
    const double along_mm = std::clamp(place.along_mm, 0.0, length_mm);
    return BowMotionOf(BowShapesAt(2.0 * along_mm / length_mm - 1.0), along_mm, length_mm);
  }
  std::size_t ClassOf(std::size_t segment) const { return spine_.is_line(segment) ? 0 : 1; }

  // Of a point, from what places leave of their points.
  void SetNoise() {
    double squares_mm2 = 0, weight = 0;
    ranks_.clear();
    inverses_.clear();
    for (const PlaceSum& place : places_) {
      const PlaceInverse inverse = InverseOf(place.sum);
      inverses_.push_back(inverse.of_felt);
      ranks_.push_back(inverse.rank);
      const LocalVector pull = PullOf(place.sum);
      squares_mm2 += place.sum(kLocalState, kLocalState) - pull.dot(inverses_.back() * pull);
      weight += std::max(0.0, place.sum(kPipeRadiusState, kPipeRadiusState) - inverse.rank);
    }
    noise_mm2_ = std::max(1e-12, squares_mm2 / std::max(1.0, weight));
  }

  void Assemble(bool with_bows) {
    for (Eigen::MatrixXd& known : known_) known.setZero(size_, size_);
    right_.setZero(size_);
    std::size_t next = 0;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      CondensedSum whole = CondensedSum::Zero();
      const std::size_t first = next;
      for (; next < places_.size() && places_[next].segment == k; ++next) {
        whole += places_[next].sum;
      }
      const double worth = 1.0 / worth_[ClassOf(k)];
      const Eigen::MatrixXd& motion = motions_[k];
      Eigen::MatrixXd& known = known_[ClassOf(k)];
      known += worth * TransposeProduct(motion, Product(InformationOf(whole), motion));
      right_.noalias() -= worth * motion.transpose() * PullOf(whole);
      if (own_[k] < 0) continue;
      BowMotion with_motion = BowMotion::Zero();
      Eigen::Matrix4d with_itself = Eigen::Matrix4d::Zero();
      Eigen::Vector4d pull = Eigen::Vector4d::Zero();
      for (std::size_t i = first; i < next; ++i) {
        const BowMotion field = OwnMotion(places_[i]);
        const BowMotion felt = InformationOf(places_[i].sum) * field;
        with_motion += felt;
        with_itself += field.transpose() * felt;
        pull += field.transpose() * PullOf(places_[i].sum);
      }
      const Eigen::MatrixXd cross = worth * TransposeProduct(motion, with_motion);
      known.middleCols<kBowModes>(own_[k]) += cross;
      known.middleRows<kBowModes>(own_[k]) += cross.transpose();
      known.block<kBowModes, kBowModes>(own_[k], own_[k]) += worth * with_itself;
      right_.segment<kBowModes>(own_[k]) -= worth * pull;
    }
    matrix_ = known_[0] + known_[1];
    AddPriors(with_bows);
  }

  void AddPriors(bool with_bows) {
    const int n = parameters_.size();
    Eigen::MatrixXd of_tube = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    fit_.priors.Add(parameters_, parameters_.Initial(), std::sqrt(noise_mm2_), of_tube, right);
    matrix_.topLeftCorner(n, n) += of_tube;
    right_.head(n) += right;
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (own_[k] < 0) continue;
      const double length_mm = spine_.segments[k].length_mm;
      for (int mode = 0; mode < kBowModes; ++mode) {
        // The bow's shape goes from -0.5 to 1; so does the other, nearly.
        const double range_mm = (mode < 2 ? kBowed.bow : kBowed.s_bow) * length_mm / 1.5;
        matrix_(own_[k] + mode, own_[k] + mode) +=
            noise_mm2_ / (with_bows ? range_mm * range_mm : kHeld * kHeld);
      }
    }
    for (int i = first_shape_; i < size_; ++i) {
      matrix_(i, i) += noise_mm2_ / std::pow(with_bows ? kBowed.shape : kHeld, 2);
    }
  }

  Eigen::VectorXd Ranges() const {
    Eigen::VectorXd range =
        Eigen::VectorXd::Constant(size_, std::numeric_limits<double>::infinity());
    range.head(parameters_.size()) = ExpectedRange(parameters_, r_mm_);
    return range;
  }

  // How far places still disagree, over what noise does. Those of straights, those of bends.
  void SetWorth() {
    std::array<double, 2> chi_square{}, freedom{};
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = places_[i].segment;
      LocalVector moved = motions_[k] * step_;
      if (own_[k] >= 0) moved += OwnMotion(places_[i]) * step_.segment<kBowModes>(own_[k]);
      const LocalVector pull = PullOf(places_[i].sum) + InformationOf(places_[i].sum) * moved;
      chi_square[ClassOf(k)] += pull.dot(inverses_[i] * pull) / noise_mm2_;
      freedom[ClassOf(k)] += ranks_[i];
    }
    // What the numbers take of it: the trace of what the places know times the covariance.
    for (const std::size_t c : {std::size_t{0}, std::size_t{1}}) {
      freedom[c] -= known_[c].cwiseProduct(inverse_).sum();
    }
    for (const std::size_t c : {std::size_t{0}, std::size_t{1}}) {
      worth_[c] = freedom[c] > 1 ? std::max(1.0, chi_square[c] / freedom[c]) : worth_[0];
    }
  }

  // A place that pulls further than noise does: without it all would lie elsewhere. How far, place
  // by place, is a covariance (a jackknife over places: Cameron & Miller, A practitioner's guide to
  // cluster-robust inference, 2015). 0 where the tube is what the model says.
  Eigen::MatrixXd Disagreement() const {
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size_, size_);
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = places_[i].segment;
      Eigen::MatrixXd motion = motions_[k];
      if (own_[k] >= 0) motion.middleCols<kBowModes>(own_[k]) += OwnMotion(places_[i]);
      const double worth = worth_[ClassOf(k)];
      const LocalMatrix information = InformationOf(places_[i].sum);
      const LocalVector pull = PullOf(places_[i].sum) + information * (motion * step_);
      const double chi_square = pull.dot(inverses_[i] * pull) / (worth * noise_mm2_);
      const double of_noise = ranks_[i] + kBowed.noise_sigmas * std::sqrt(2.0 * ranks_[i]);
      if (!(chi_square > of_noise)) continue;
      const Eigen::MatrixXd back = Product(inverse_, motion.transpose());
      const LocalMatrix others =
          LocalMatrix::Identity() -
          kBowed.leverage / worth * Product(information, Product(motion, back));
      const Eigen::VectorXd moves = back * (Inverse(others) * pull) / worth;
      sum.noalias() += (1.0 - of_noise / chi_square) * moves * moves.transpose();
    }
    return sum;
  }

  // The straights' best-fit lines where `numbers` are so much more.
  std::vector<Line> LinesAt(const Eigen::VectorXd& numbers) const {
    std::vector<Line> lines;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      if (!spine_.is_line(k)) continue;
      const hal::SpineSegment& straight = spine_.segments[k];
      LocalVector motion = motions_[k] * numbers;
      if (own_[k] >= 0) {
        const double length_mm = straight.length_mm;
        motion +=
            BowMotionOf(BowLinesOf(1.0 - 2.0 * kBowed.beside_bend), 0.5 * length_mm, length_mm) *
            numbers.segment<kBowModes>(own_[k]);
      }
      const Eigen::Matrix3d axes = straight.axes();
      const Eigen::Vector3d turn = axes * motion.segment<3>(3);
      const Eigen::Vector3d direction = straight.tangent + turn.cross(straight.tangent);
      lines.push_back({straight.start_mm + axes * motion.head<3>(), direction.normalized()});
    }
    return lines;
  }

  // Lengths, rotations and angles of these lines, as parameters; the others as `numbers` have them.
  // Of lines that pass each other the corner is halfway.
  Eigen::VectorXd RowsAt(const Eigen::VectorXd& numbers) const {
    const std::vector<Line> lines = LinesAt(numbers);
    Eigen::VectorXd to = parameters_.Initial() + numbers.head(parameters_.size());
    // Where a line has its corners, along it from its point; the first from the tube's start.
    std::vector<double> before_mm(lines.size(), 0.0), after_mm(lines.size(), 0.0);
    before_mm[0] = (fit_.tube.X_WT.position_mm - lines[0].point).dot(lines[0].direction);
    Eigen::Vector3d last_normal = Eigen::Vector3d::Zero();
    std::vector<double> tangent_mm(lines.size() + 1, 0.0);
    for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
      const Line &a = lines[i], &b = lines[i + 1];
      Eigen::Vector3d normal = a.direction.cross(b.direction);
      const Eigen::Vector3d between = b.point - a.point;
      after_mm[i] = between.cross(b.direction).dot(normal) / normal.squaredNorm();
      before_mm[i + 1] = between.cross(a.direction).dot(normal) / normal.squaredNorm();
      normal.normalize();
      const double angle =
          std::atan2(a.direction.cross(b.direction).norm(), a.direction.dot(b.direction));
      to[parameters_.angle(i)] = angle;
      tangent_mm[i + 1] = to[parameters_.bend_radius(i)] * std::tan(0.5 * angle);
      if (i > 0) {
        const double rotation =
            std::atan2(last_normal.cross(normal).dot(a.direction), last_normal.dot(normal));
        double& at = to[parameters_.rotation(i)];
        at += std::remainder(rotation - at, 2.0 * std::numbers::pi);
      }
      last_normal = normal;
    }
    for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
      to[parameters_.length(i)] = after_mm[i] - before_mm[i] - tangent_mm[i] - tangent_mm[i + 1];
    }
    return to;
  }

  // Where the tube of these lines lies: its lines as near to them as can be.
  Eigen::VectorXd WithPose(const Eigen::VectorXd& numbers, Eigen::VectorXd to) const {
    const int pose =
        parameters_.pipe_radius() >= 0 ? parameters_.pipe_radius() : parameters_.length(0);
    Eigen::VectorXd rows = to - parameters_.Initial();
    rows.head(pose).setZero();
    Eigen::MatrixXd left = Eigen::MatrixXd::Zero(pose, pose);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(pose);
    const std::vector<Line> lines = LinesAt(numbers);
    std::size_t line = 0;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      if (!spine_.is_line(k)) continue;
      const hal::SpineSegment& straight = spine_.segments[k];
      const double half_mm = 0.5 * straight.length_mm;
      const Eigen::Matrix3d axes = straight.axes();
      Eigen::Matrix<double, 4, kLocalState> look = Eigen::Matrix<double, 4, kLocalState>::Zero();
      Eigen::Vector4d off = Eigen::Vector4d::Zero();
      for (const int end : {0, 1}) {
        const double along_mm = end * 2.0 * half_mm;
        look(2 * end, 1) = look(2 * end + 1, 2) = 1.0;
        look(2 * end, 5) = along_mm;
        look(2 * end + 1, 4) = -along_mm;
        const Eigen::Vector3d there = lines[line].point + along_mm * lines[line].direction -
                                      straight.start_mm - along_mm * straight.tangent;
        off[2 * end] = axes.col(1).dot(there);
        off[2 * end + 1] = axes.col(2).dot(there);
      }
      const Eigen::MatrixXd of_tube = Product(look, derivatives_[k]);
      left += TransposeProduct(of_tube, of_tube).topLeftCorner(pose, pose);
      right += of_tube.leftCols(pose).transpose() * (off - of_tube * rows);
      ++line;
    }
    to.head(pose) = parameters_.Initial().head(pose) + SolveSymmetric(left, right);
    return to;
  }

  // How far the ends of the tube's straights lie beside the best-fit lines, at most.
  double FarthestEndMm(const hal::Tube& tube) const {
    const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
    const std::vector<Line> lines = LinesAt(step_);
    double most_mm = 0;
    for (std::size_t line = 0; line < lines.size(); ++line) {
      const hal::SpineSegment& straight = segments[2 * line];
      for (const double along_mm : {0.0, straight.length_mm}) {
        const Eigen::Vector3d off = straight.PointAt(along_mm) - lines[line].point;
        most_mm = std::max(most_mm, off.cross(lines[line].direction).norm());
      }
    }
    return most_mm;
  }

  Eigen::VectorXd TradeAt(const Eigen::VectorXd& numbers) const {
    return WithPose(numbers, RowsAt(numbers));
  }

  // Its derivative, where it is linear enough for differences of a thousandth of a sigma.
  Eigen::MatrixXd TradeMap() const {
    Eigen::MatrixXd map(parameters_.size(), size_);
    for (int i = 0; i < size_; ++i) {
      const double small =
          std::max(1e-9, 1e-2 * std::sqrt(std::max(0.0, noise_mm2_ * inverse_(i, i))));
      Eigen::VectorXd more = step_, less = step_;
      more[i] += small;
      less[i] -= small;
      map.col(i) = (TradeAt(more) - TradeAt(less)) / (2.0 * small);
    }
    return map;
  }

  const SurfaceFit& fit_;
  const SurfaceFitOptions& options_;
  TubeParameters parameters_;
  double r_mm_;
  EasedSpine spine_;
  std::vector<SegmentFrame> frames_;
  std::vector<int> own_;  // of a segment: its first number of bow, or -1
  int size_ = 0;
  std::vector<Eigen::MatrixXd> derivatives_, motions_;
  std::vector<PlaceSum> places_;
  std::vector<double> ranks_;
  std::vector<LocalMatrix> inverses_;
  double noise_mm2_ = 0;
  std::array<double, 2> worth_{1.0, 1.0};
  int first_shape_ = 0;
  std::array<Eigen::MatrixXd, 2> known_;  // information of straights, of bends
  Eigen::MatrixXd matrix_, inverse_;
  Eigen::VectorXd right_, step_;
};

}  // namespace

void FitBows(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
             SurfaceFit& fit) {
  const auto& rows = fit.tube.program.rows;
  const bool has_corners = std::all_of(rows.begin(), rows.end() - 1, [](const hal::BendRow& row) {
    return row.angle_deg > kBowed.least_deg && row.angle_deg < kBowed.most_deg;
  });
  if (!has_corners || rows.size() < 2) return;
  const std::size_t points = CountPoints(blocks);
  const OwnedBlocks few = Thinned(blocks, StrideTo(points, kBowed.few_points));
  OwnedBlocks enough(0);
  double wide_mm = 0;
  for (int round = 0; round < kBowed.rounds; ++round) {
    const SurfaceFit before = fit;
    BowedTube tube(before, options);
    tube.Take(round == 0 ? few : enough, wide_mm);
    tube.Solve(true);
    const double with_bows = tube.Gain();
    tube.Solve(false);
    const double freedom = static_cast<double>(kBowModes * tube.bows());
    const double more = with_bows - tube.Gain();
    if (round == 0 && more < freedom + kBowed.insist * std::sqrt(2.0 * freedom)) {
      return tube.Doubt(false, fit);
    }
    tube.Solve(true);
    if (!tube.MoveTo(fit)) return tube.Doubt(true, fit);
    if (round == 0) enough = Thinned(blocks, StrideTo(points, kBowed.enough_points));
    wide_mm = kBowed.wide * tube.HighestBow();
  }
}

}  // namespace bendloop::pipeline
