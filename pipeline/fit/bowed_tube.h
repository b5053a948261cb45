// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "pipeline/fit/bow_shapes.h"
#include "pipeline/fit/bowed_spine.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/trade_rows.h"
#include "pipeline/fit/tube_parameters.h"

namespace bendloop::pipeline {

// By trial where nothing else is said.
struct BowedSettings {
  // So many points tell whether there is anything, and if not, so many; so many do it then.
  std::size_t few_points = 20'000, many_points = 1'000'000, enough_points = 200'000;
  // [of r_P] Of a place along the spine.
  double place = 1.5;
  // [of r_P] Shorter straights have no bow, nor those of which the bends beside them leave less.
  // What a straight of 1.3 r_P bows by turns the bends beside it by half a degree (L / 320).
  double shortest = 0.7, shortest_left = 0.05;
  // [of a straight's length] 1 sigma of a bow's height, of one that changes sides, and of the
  // fourth polynomial, of which half a sine has 0.075 of its second, and a parabola none: L / 300
  // is the worst that is sold as straight.
  double bow = 0.002, s_bow = 0.001, w_bow = 0.0001;
  // [of the slope of a bow at its ends, and of what part of its straight the tube's bends ease
  // over] How far nobody knows how it goes on there: so much its best-fit line may be turned. By
  // trial.
  double bows_on = 0.03;
  // [of a straight's length] Beyond it a solution has gone astray.
  double most_bow = 0.02;
  // [of the highest bow] Beside the noise, for the first weights: what bows leave is no outlier.
  double wide = 0.3;
  // And how fast these weights may narrow, round by round: beside a noise of a thousandth of r_P
  // what is not yet bowed right would have no say any more.
  double narrower = 0.7;
  // [of a bend's radius] 1 sigma of one that the samples know.
  double known_radius = 0.1;
  // 1 sigma of the kernel's reach, bend by bend about the tube's.
  double shape = 0.15;
  // [sigma] From which on samples insist.
  double insist = 6.0;
  // Of a place's information that is taken away with it: 1 is a jackknife, which overdoes where a
  // place alone tells of a number; and [standard deviations] of what noise pulls, which is not
  // counted, and from which on something pressed or lies there. Of bowed tubes all beyond the mean
  // counts: six numbers a straight are not all of its form.
  double leverage = 0.5, noise_sigmas = 2.0, noise_sigmas_of_bowed = 0.0, no_noise_sigmas = 6.0;
  // The tube's straights lie as near to the best-fit lines: [times the highest bow], [of r_P].
  double near_bows = 6.0, near = 0.1;
  // Times that points are laid on the bowed tube anew, at least and at most; then so many of them
  // as are enough, until it rests; and that what places disagree by is learnt from a solution.
  int least_rounds = 3, most_rounds = 8, most_last_rounds = 5, steps = 3;
  // [variances] What another round explains of a tube that rests.
  double at_rest = 2.0;
  // [variances a point] What a round more would explain: with more the solution has not settled.
  double settled = 0.1;
  // [of those of the straight tube] Points that have a say: with fewer it has lost its way, unless
  // it explains all of them better and they are those of dents, which the straight tube does not
  // tell from its bows.
  double kept = 0.97, kept_beside_dents = 0.8;
  // [degrees] Bends so slight that their radius moves the spine by radius * angle^2 / 8.
  double slight_deg = 10;
  // [degrees] Bends that have a corner.
  double least_deg = 0.3, most_deg = 160;
};
inline constexpr BowedSettings kBowed;

// [mm] 1 sigma of the height of a shape, of a straight so long; they go from -0.5 to 1 or nearly.
inline double BowRangeMm(std::size_t shape, double length_mm) {
  const std::array<double, kBowShapes> of_length{kBowed.bow, kBowed.s_bow, kBowed.w_bow};
  return of_length[shape] * length_mm / 1.5;
}

// Whether all bends have a corner.
bool HasCorners(const hal::BendProgram& program);

inline LocalMatrix InformationOf(const CondensedSum& sum) {
  return sum.topLeftCorner<kLocalState, kLocalState>();
}
inline LocalVector PullOf(const CondensedSum& sum) {
  return sum.col(kLocalState).head<kLocalState>();
}

// The tube's parameters and, straight by straight, the numbers of its bow.
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
    tails_.assign(own_.size(), LocalVector::Zero());
    for (std::size_t k = 0; k < own_.size(); ++k) {
      if (!spine_.is_line(k)) continue;
      const BowModes modes_mm = state_.bows[k].modes_mm;
      state_.bows[k] = ExtentOf(state_, spine_, k);
      tails_[k] = TailsOf(spine_, state_.bows[k], k);
      if (!MayBow(k)) continue;
      state_.bows[k].modes_mm = modes_mm;
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
  void Take(std::span<const PointBlock> blocks, double sigma_mm);

  // `with_bows`: or as if all straights were straight.
  void Solve(bool with_bows);

  // How far straights lie off their lines, at most [mm].
  double HighestBow() const;
  double noise_mm() const { return std::sqrt(noise_mm2_); }
  double worth() const { return std::max(worth_[0], worth_[1]); }
  // Of a tube: no straight bows by more than could still be called one.
  bool IsSolved() const;
  std::size_t bows() const {
    return static_cast<std::size_t>(
        std::count_if(own_.begin(), own_.end(), [](int own) { return own >= 0; }));
  }
  // Points that have a say.
  double Weight() const {
    double weight = 0;
    for (const PlaceSum& place : places_) weight += place.sum(kPipeRadiusState, kPipeRadiusState);
    return weight;
  }
  // Whether a step more hardly moves it.
  bool IsSettled() const { return Gain() < kBowed.settled * Weight(); }
  // What it leaves of what pulls the places [variances of noise].
  double Left() const;
  // What the step explains [variances].
  double Gain() const { return step_.dot(right_) / noise_mm2_; }

  // Of the bends whose radius the samples know; none of them does: none.
  std::optional<double> UsualRadius() const;

  // Where the step leads.
  BowedTubeState Next() const;

  bool IsPulledAside() const;

  // From the step: the tube whose straights are best-fit lines. False: there is none near them, as
  // where a slight bend has no corner.
  bool MoveTo(SurfaceFit& fit) const;

  // As it is, to the straights' best-fit lines: bends that ease into their middles turn these.
  void MoveToLines(SurfaceFit& fit) const;

  // The tube stays; what places disagree by makes it less certain, and where it would rather be.
  void Doubt(bool would_move, SurfaceFit& fit) const;

 private:
  bool MayBow(std::size_t k) const {
    return spine_.is_line(k) && spine_.segments[k].length_mm >= kBowed.shortest_left * r_mm_ &&
           state_.tube.program.rows[spine_.row(k)].length_mm >= kBowed.shortest * r_mm_;
  }

  // Of every segment's frame by all numbers; a straight's own bow moves its places one by one.
  void SetMotions();
  // By the bow of segment `j`: turned by so much about a place, from the segment `first` on.
  void AddTurn(std::size_t j, std::size_t first, const Eigen::Vector3d& place_mm,
               const Eigen::Matrix<double, 3, kBowModes>& velocity,
               const Eigen::Matrix<double, 3, kBowModes>& turn);

  // Of every bend its own kernel beside the tube's: what moves its pieces moves nothing behind
  // them.
  void SetShapes();

  // The parameters after a step, which leads to a tube.
  Eigen::VectorXd Within(const Eigen::VectorXd& step) const {
    const FitBounds bounds(parameters_, r_mm_, options_.max_length_mm);
    return bounds.Inside(parameters_.Initial() + step.head(parameters_.size()));
  }
  // [mm] Of a straight that may bow.
  double LengthOf(std::size_t k) const {
    return state_.bows[k].LengthMm(spine_.segments[k].length_mm);
  }
  BowMotion LineMotion(std::size_t k) const {
    return ToBestFitLine(state_.bows[k], spine_.segments[k].length_mm);
  }
  BowModes BowAt(std::size_t k, const Eigen::VectorXd& numbers) const {
    return state_.bows[k].modes_mm + numbers.segment<kBowModes>(own_[k]);
  }

  BowMotion OwnMotion(const PlaceSum& place) const {
    const double length_mm = spine_.segments[place.segment].length_mm;
    const double along_mm = std::clamp(place.along_mm, 0.0, length_mm);
    const Bow& bow = state_.bows[place.segment];
    return BowMotionOf(bow, BowShapesAt(bow.At(along_mm, length_mm)), along_mm, length_mm);
  }
  std::size_t ClassOf(std::size_t segment) const { return spine_.is_line(segment) ? 0 : 1; }

  // Of a point, from what places leave of their points.
  void SetNoise();

  // What the samples say, straights and bends apart, as if all of them were worth their number.
  void SumKnown();

  void Assemble(bool with_bows);

  void AddPriors(bool with_bows);

  Eigen::VectorXd Ranges() const;

  Eigen::MatrixXd MotionOf(const PlaceSum& place) const;
  // What still pulls a place after the step.
  LocalVector LeftPull(const PlaceSum& place) const;
  // The same in variances of noise, and of what samples are worth.
  double LeftAt(std::size_t i) const {
    const LocalVector pull = LeftPull(places_[i]);
    return pull.dot(inverses_[i] * pull) / noise_mm2_;
  }
  double PulledAside(std::size_t i) const {
    return LeftAt(i) / worth_[ClassOf(places_[i].segment)];
  }

  // How far places still disagree, over what noise does. Those of straights, those of bends.
  void SetWorth();

  // A place that pulls further than noise does: without it all would lie elsewhere. How far, place
  // by place, is a covariance (a jackknife over places: Cameron & Miller, A practitioner's guide to
  // cluster-robust inference, 2015). 0 where the tube is what the model says.
  Eigen::MatrixXd Disagreement(double noise_sigmas) const;

  // How far the part of a straight that its best-fit line is of moves along, where `numbers` are so
  // much more: the samples tell a bow, but hardly where a slight bend begins.
  double MiddleShiftMm(std::size_t k, const Eigen::VectorXd& numbers) const;
  // What that does to the line of one that bows.
  LocalVector LineTurn(std::size_t k, double shift_mm) const;
  // The straights' best-fit lines where `numbers` are so much more.
  std::vector<SpineLine> LinesAt(const Eigen::VectorXd& numbers) const;

  Eigen::VectorXd TradeAt(const Eigen::VectorXd& numbers) const;

  // How sure rows are of a tube whose straights bow a little otherwise than by these shapes.
  Eigen::MatrixXd OtherBows() const;

  // Its derivative, where it is linear enough for differences of a thousandth of a sigma.
  Eigen::MatrixXd TradeMap() const;

  // Of a bend's radius the samples know no more than what it moves of the spine, which the
  // derivative at a radius as tight as the pipe does not say. [mm] 1 sigma.
  double LeastRadiusSigmaMm(const hal::BendProgram& program, std::size_t bend) const;
  // With that of slight bends; the straights beside them are known as little.
  Eigen::MatrixXd NoSurer(const TubeParameters& at, const hal::BendProgram& program,
                          Eigen::MatrixXd covariance) const;

  const SurfaceFit& fit_;
  BowedTubeState state_;
  std::optional<double> usual_radius_mm_;
  const SurfaceFitOptions& options_;
  TubeParameters parameters_;
  double r_mm_;
  EasedSpine spine_;
  std::vector<SegmentFrame> frames_;
  std::vector<LocalVector> tails_;  // of a straight's line
  std::vector<int> own_;            // of a segment: its first number of bow, or -1
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

}  // namespace bendloop::pipeline
