// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/bowed_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/trade_rows.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/cross_matrix.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

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
  // [of a straight's length] Beyond it a solution has gone astray.
  double most_bow = 0.02;
  // [of the highest bow] Beside the noise, for the first weights: what bows leave is no outlier.
  double wide = 0.3;
  // [of a bend's radius] 1 sigma of one that the samples know.
  double known_radius = 0.1;
  // 1 sigma of the kernel's reach, bend by bend about the tube's.
  double shape = 0.15;
  // [sigma] From which on samples insist.
  double insist = 6.0;
  // Of a place's information that is taken away with it: 1 is a jackknife, which overdoes where a
  // place alone tells of a number; and [standard deviations] of what noise pulls, which is not
  // counted, and from which on something pressed or lies there.
  double leverage = 0.5, noise_sigmas = 2.0, no_noise_sigmas = 6.0;
  // The tube's straights lie as near to the best-fit lines: [times the highest bow], [of r_P].
  double near_bows = 6.0, near = 0.1;
  // Times that points are laid on the bowed tube anew, the last time so many of them as are enough;
  // and that what places disagree by is learnt from a solution.
  int rounds = 3, steps = 3;
  // [degrees] Bends that have a corner.
  double least_deg = 0.3, most_deg = 160;
};
constexpr BowedSettings kBowed;

constexpr double kHeld = 1e-9;  // 1 sigma of a number that stays 0

LocalMatrix InformationOf(const CondensedSum& sum) {
  return sum.topLeftCorner<kLocalState, kLocalState>();
}
LocalVector PullOf(const CondensedSum& sum) { return sum.col(kLocalState).head<kLocalState>(); }

bool HasCorners(const hal::BendProgram& program) {
  return std::all_of(program.rows.begin(), program.rows.end() - 1, [](const hal::BendRow& row) {
    return row.angle_deg > kBowed.least_deg && row.angle_deg < kBowed.most_deg;
  });
}

// The tube's parameters and, straight by straight, four numbers of its bow.
class BowedTube {
 public:
  // `fit`: without bows; `state`: where it has come to. `usual_radius_mm`: of bends.
  BowedTube(const SurfaceFit& fit, BowedTubeState state, std::optional<double> usual_radius_mm,
            const SurfaceFitOptions& options)
      : fit_(fit),
        state_(std::move(state)),
        usual_radius_mm_(usual_radius_mm),
        options_(options),
        parameters_(state_.tube, options.free_pipe_radius, state_.flattening, state_.easing),
        r_mm_(state_.tube.pipe_radius_mm),
        spine_(SpineOf(state_.tube.program, state_.tube.X_WT, state_.easing)),
        own_(spine_.segments.size(), -1) {
    state_.bows.resize(own_.size());
    int next = parameters_.size();
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (!spine_.is_line(k) || spine_.segments[k].length_mm < kBowed.shortest * r_mm_) {
        state_.bows[k] = {};
        continue;
      }
      state_.bows[k].middle = MiddleOf(state_, spine_, k);
      own_[k] = next;
      next += kBowModes;
    }
    spine_ = SpineOf(state_);
    frames_ = SegmentFrames(spine_, kBeyond * r_mm_, state_.flattening);
    first_shape_ = next;
    if (parameters_.eased()) next += static_cast<int>(parameters_.bends());
    size_ = next;
    SetMotions();
    SetShapes();
  }

  // `sigma_mm`: of the distances, for the weights.
  void Take(std::span<const PointBlock> blocks, double sigma_mm) {
    places_ = SumPlaces(spine_, frames_, r_mm_, kBowed.place * r_mm_, blocks, options_.reach_mm,
                        sigma_mm, state_.bows);
    SetNoise();
    SumKnown();
    worth_ = {1.0, 1.0};
  }

  // `with_bows`: or as if all straights were straight.
  void Solve(bool with_bows) {
    for (int i = 0; i < kBowed.steps; ++i) {
      const std::array<double, 2> worth = worth_;
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
      if (worth_ == worth) break;  // as it would be again
    }
  }

  // How far straights lie off their lines, at most [mm].
  double HighestBow() const {
    double most_mm = 0;
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (own_[k] >= 0) most_mm = std::max(most_mm, BowAt(k, step_).cwiseAbs().maxCoeff());
    }
    return most_mm;
  }
  double noise_mm() const { return std::sqrt(noise_mm2_); }
  double worth() const { return std::max(worth_[0], worth_[1]); }
  // Of a tube: no straight bows by more than could still be called one.
  bool IsSolved() const {
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (own_[k] < 0) continue;
      const double height_mm = BowAt(k, step_).cwiseAbs().maxCoeff();
      if (!(height_mm < kBowed.most_bow * spine_.segments[k].length_mm)) return false;
    }
    return step_.allFinite() && inverse_.allFinite();
  }
  std::size_t bows() const {
    return static_cast<std::size_t>(
        std::count_if(own_.begin(), own_.end(), [](int own) { return own >= 0; }));
  }
  // What the step explains [variances].
  double Gain() const { return step_.dot(right_) / noise_mm2_; }

  // Of the bends whose radius the samples know; none of them does: none.
  std::optional<double> UsualRadius() const {
    std::vector<double> known_mm;
    for (std::size_t i = 0; i < parameters_.bends(); ++i) {
      const int at = parameters_.bend_radius(i);
      const double radius_mm = parameters_.Initial()[at] + step_[at];
      const double variance_mm2 = noise_mm2_ * std::max(0.0, inverse_(at, at));
      if (std::sqrt(variance_mm2) < kBowed.known_radius * radius_mm) known_mm.push_back(radius_mm);
    }
    if (known_mm.empty()) return std::nullopt;
    return Median(std::move(known_mm));
  }

  // Where the step leads.
  BowedTubeState Next() const {
    const Eigen::VectorXd to = Within(step_);
    BowedTubeState next{parameters_.TubeAt(to), parameters_.FlatteningAt(to),
                        parameters_.EasingAt(to), state_.bows};
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (own_[k] >= 0) next.bows[k].modes_mm = BowAt(k, step_);
    }
    return next;
  }

  bool IsPulledAside() const {
    for (std::size_t i = 0; i < places_.size(); ++i) {
      if (PulledAside(i) > ranks_[i] + kBowed.no_noise_sigmas * std::sqrt(2.0 * ranks_[i])) {
        return true;
      }
    }
    return false;
  }

  // From the step: the tube whose straights are best-fit lines. False: there is none near them, as
  // where a slight bend has no corner.
  bool MoveTo(SurfaceFit& fit) const {
    const Eigen::MatrixXd map = TradeMap();
    Eigen::VectorXd step = step_;
    step.head(parameters_.size()) = Within(step_) - parameters_.Initial();
    const Eigen::VectorXd to = TradeAt(step);
    if (!to.allFinite() || !map.allFinite()) return false;
    SurfaceFit moved = fit;
    moved.tube = TradeTube(parameters_, state_.tube, to);
    if (!HasCorners(moved.tube.program)) return false;
    if (FarthestEndMm(moved.tube, LinesAt(step_)) >
        kBowed.near_bows * HighestBow() + kBowed.near * r_mm_) {
      return false;
    }
    moved.flattening = parameters_.FlatteningAt(to);
    moved.easing = parameters_.EasingAt(to);
    const TubeParameters at(moved.tube, options_.free_pipe_radius, moved.flattening, moved.easing);
    const EasedSpine spine = SpineOf(moved.tube.program, moved.tube.X_WT, moved.easing);
    moved.last_start = at.FrameDerivatives(spine).back().row(0);
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

  // The parameters after a step, which leads to a tube.
  Eigen::VectorXd Within(const Eigen::VectorXd& step) const {
    const FitBounds bounds(parameters_, r_mm_, options_.max_length_mm);
    return bounds.Inside(parameters_.Initial() + step.head(parameters_.size()));
  }
  BowMotion LineMotion(std::size_t k) const {
    return ToBestFitLine(state_.bows[k], spine_.segments[k].length_mm);
  }
  Eigen::Vector4d BowAt(std::size_t k, const Eigen::VectorXd& numbers) const {
    return state_.bows[k].modes_mm + numbers.segment<kBowModes>(own_[k]);
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

  // What the samples say, straights and bends apart, as if all of them were worth their number.
  void SumKnown() {
    for (Known& known : known_) {
      known.information.setZero(size_, size_);
      known.right.setZero(size_);
    }
    std::size_t next = 0;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      CondensedSum whole = CondensedSum::Zero();
      const std::size_t first = next;
      for (; next < places_.size() && places_[next].segment == k; ++next) {
        whole += places_[next].sum;
      }
      const Eigen::MatrixXd& motion = motions_[k];
      auto& [information, right] = known_[ClassOf(k)];
      information += TransposeProduct(motion, Product(InformationOf(whole), motion));
      right.noalias() -= motion.transpose() * PullOf(whole);
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
      const Eigen::MatrixXd cross = TransposeProduct(motion, with_motion);
      information.middleCols<kBowModes>(own_[k]) += cross;
      information.middleRows<kBowModes>(own_[k]) += cross.transpose();
      information.block<kBowModes, kBowModes>(own_[k], own_[k]) += with_itself;
      right.segment<kBowModes>(own_[k]) -= pull;
    }
  }

  void Assemble(bool with_bows) {
    matrix_ = known_[0].information / worth_[0] + known_[1].information / worth_[1];
    right_ = known_[0].right / worth_[0] + known_[1].right / worth_[1];
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
        const double certainty = noise_mm2_ / (with_bows ? range_mm * range_mm : kHeld * kHeld);
        matrix_(own_[k] + mode, own_[k] + mode) += certainty;
        right_[own_[k] + mode] -= certainty * state_.bows[k].modes_mm[mode];
      }
    }
    // A bow beside a slight bend is as good as another radius of that: what the samples do not know
    // is as usual, within ExpectedRange().
    const Eigen::VectorXd range = Ranges();
    for (std::size_t i = 0; usual_radius_mm_ && i < parameters_.bends(); ++i) {
      const int at = parameters_.bend_radius(i);
      right_[at] +=
          noise_mm2_ / (range[at] * range[at]) * (*usual_radius_mm_ - parameters_.Initial()[at]);
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

  Eigen::MatrixXd MotionOf(const PlaceSum& place) const {
    const std::size_t k = place.segment;
    Eigen::MatrixXd motion = motions_[k];
    if (own_[k] >= 0) motion.middleCols<kBowModes>(own_[k]) += OwnMotion(place);
    return motion;
  }
  // What still pulls a place after the step.
  LocalVector LeftPull(const PlaceSum& place) const {
    const std::size_t k = place.segment;
    LocalVector moved = motions_[k] * step_;
    if (own_[k] >= 0) moved += OwnMotion(place) * step_.segment<kBowModes>(own_[k]);
    return PullOf(place.sum) + InformationOf(place.sum) * moved;
  }
  // The same in variances of what samples are worth.
  double PulledAside(std::size_t i) const {
    const LocalVector pull = LeftPull(places_[i]);
    return pull.dot(inverses_[i] * pull) / (worth_[ClassOf(places_[i].segment)] * noise_mm2_);
  }

  // How far places still disagree, over what noise does. Those of straights, those of bends.
  void SetWorth() {
    const std::array<double, 2> worth = worth_;
    std::array<double, 2> chi_square{}, freedom{};
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const std::size_t k = places_[i].segment;
      const LocalVector pull = LeftPull(places_[i]);
      chi_square[ClassOf(k)] += pull.dot(inverses_[i] * pull) / noise_mm2_;
      freedom[ClassOf(k)] += ranks_[i];
    }
    // What the numbers take of it: the trace of what the places know times the covariance.
    for (const std::size_t c : {std::size_t{0}, std::size_t{1}}) {
      freedom[c] -= known_[c].information.cwiseProduct(inverse_).sum() / worth[c];
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
      const double worth = worth_[ClassOf(places_[i].segment)];
      const Eigen::MatrixXd motion = MotionOf(places_[i]);
      const LocalMatrix information = InformationOf(places_[i].sum);
      const LocalVector pull = LeftPull(places_[i]);
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
  std::vector<SpineLine> LinesAt(const Eigen::VectorXd& numbers) const {
    std::vector<SpineLine> lines;
    for (std::size_t k = 0; k < frames_.size(); ++k) {
      if (!spine_.is_line(k)) continue;
      const hal::SpineSegment& straight = spine_.segments[k];
      LocalVector motion = motions_[k] * numbers;
      if (own_[k] >= 0) {
        motion += LineMotion(k) * numbers.segment<kBowModes>(own_[k]);
      }
      const Eigen::Matrix3d axes = straight.axes();
      const Eigen::Vector3d turn = axes * motion.segment<3>(3);
      const Eigen::Vector3d direction = straight.tangent + turn.cross(straight.tangent);
      lines.push_back({straight.start_mm + axes * motion.head<3>(), direction.normalized()});
    }
    return lines;
  }

  Eigen::VectorXd TradeAt(const Eigen::VectorXd& numbers) const {
    return TradeNumbers(parameters_, state_.tube, LinesAt(numbers),
                        parameters_.Initial() + numbers.head(parameters_.size()));
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
  BowedTubeState state_;
  std::optional<double> usual_radius_mm_;
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
  struct Known {
    Eigen::MatrixXd information;
    Eigen::VectorXd right;
  };
  std::array<Known, 2> known_;  // of straights, of bends
  Eigen::MatrixXd matrix_, inverse_;
  Eigen::VectorXd right_, step_;
};

}  // namespace

BowedFit FitBows(std::span<const PointBlock> blocks, const SurfaceFitOptions& options,
                 SurfaceFit& fit) {
  const BowedTubeState no_bows{fit.tube, fit.flattening, fit.easing, {}};
  if (!HasCorners(fit.tube.program) || fit.tube.program.bend_count() == 0) {
    return {no_bows, fit.sigma_mm, fit.design_effect, true};
  }
  const std::size_t points = CountPoints(blocks);
  const OwnedBlocks few = Thinned(blocks, StrideTo(points, kBowed.few_points));
  const SurfaceFit before = fit;
  BowedTube straight(before, no_bows, std::nullopt, options);
  straight.Take(few, fit.sigma_mm);
  straight.Solve(true);
  const double with_bows = straight.Gain();
  straight.Solve(false);
  const double freedom = static_cast<double>(kBowModes * straight.bows());
  const double more = with_bows - straight.Gain();
  if (!(more > freedom + kBowed.insist * std::sqrt(2.0 * freedom))) {
    straight.Doubt(false, fit);
    return {no_bows, straight.noise_mm(), straight.worth(), straight.IsPulledAside()};
  }
  straight.Solve(true);
  const OwnedBlocks enough = Thinned(blocks, StrideTo(points, kBowed.enough_points));
  BowedFit bows{straight.Next(),
                std::hypot(straight.noise_mm(), kBowed.wide * straight.HighestBow()),
                straight.worth(), true};
  std::optional<double> usual_radius_mm = straight.UsualRadius();
  for (int round = 1; round <= kBowed.rounds; ++round) {
    EndWithPoints(few, options.reach_mm, bows.state);
    BowedTube bowed(before, std::move(bows.state), usual_radius_mm, options);
    const bool is_last = round == kBowed.rounds;
    bowed.Take(is_last ? enough : few, bows.noise_mm);
    bowed.Solve(true);
    if (!bowed.IsSolved() || (is_last && !bowed.MoveTo(fit))) {
      straight.Doubt(true, fit);
      return {no_bows, straight.noise_mm(), straight.worth(), true};
    }
    bows = {bowed.Next(), std::max(options.min_sigma_mm, bowed.noise_mm()), bowed.worth(),
            bowed.IsPulledAside()};
    usual_radius_mm = bowed.UsualRadius();
  }
  return bows;
}

}  // namespace bendloop::pipeline
