// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/opening_border.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <tuple>
#include <vector>

#include "pipeline/features/opening_likelihood.h"
#include "pipeline/features/posterior.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

struct BorderSettings {
  // [sigma] A slot is longer than wide by so much, and by this part of its width.
  double slot_sigmas = 5.0, slot_part = 0.08;
  // [sigma] From radial; drills that are closer are told as radial, and so are those that are
  // likely by less than this to lean, and to lean so and not the other way.
  double lean_sigmas = 5.0, sure_lean = 0.98;
  // Part of the drills that lean before the scan, and by how much: all of them about as likely,
  // from what a drill is hardly radial by to 1 sigma of the usual; and the most.
  double leaning = 0.5, little_lean = 0.05, usual_lean = 0.35, most_lean = 1.2;
  double slots = 0.5;  // for each hole
  // [of its width] Slots are up to so much longer than wide, and none of it is likelier before the
  // scan.
  double usually_longer = 3.0;
  // [sigma] An oval that is so much longer than wide leans one way or the other along its length;
  // a rounder one may lean anywhere.
  double oval_sigmas = 1.5;
  // The oval that a lean leaves is no longer than that by so many sigma, and this many times.
  double oval_most = 3.0, longer_oval = 1.1;
  // Of the most lean: a walk that ends so near to it would go on.
  double no_more = 0.9;
  // Steps of the walk, of one that says whether a hole may lean at all, from so many sigma on, and
  // of one over leans, which are tied to the place.
  int walk = 2500, short_walk = 600, lean_walk = 5000;
  double may_lean = 2.5;
  // Of its width: a slot that is so long may have samples in it, and its sides rest on few.
  double long_slot = 2.0;
  // [of its length] How far beyond either end such a one is looked for, in so many steps.
  double lengthened = 0.25;
  int lengths = 4;
  // Of lines: walks before, over samples and rays that are displaced so many times more. Short
  // ones do but for slots, whose ends have far to go.
  std::array<double, 3> blurs = {20.0, 5.0, 2.0};
  // The same of a long slot in scattered samples, by how far these lie apart.
  std::array<double, 2> gaps = {0.5, 0.2};
};
constexpr BorderSettings kBorder;

// Whether a walk went anywhere, in each number, beside what was known before it: one that found no
// way says less.
bool WentOn(const Posterior& walk, const Posterior& before) {
  constexpr double kLeast = 1e-5;  // of the variance
  return (walk.covariance.diagonal().array() > kLeast * before.covariance.diagonal().array()).all();
}

enum class Shape { kHole, kLeaningHole, kSlot };

// Numbers of a border: place, half width; of a slot half of what it is longer and the axis, of a
// leaning hole its lean.
OpeningBorder BorderOf(const Eigen::VectorXd& x, Shape shape, const OpeningBorder& about) {
  OpeningBorder border;
  border.pipe_radius_mm = about.pipe_radius_mm;
  border.is_bent = about.is_bent;
  border.middle_mm = x.head<2>();
  border.width_mm = 2.0 * x[2];
  border.length_mm = border.width_mm + (shape == Shape::kSlot ? 2.0 * x[3] : 0.0);
  border.axis_rad = shape == Shape::kSlot ? x[4] : 0.0;
  if (shape == Shape::kLeaningHole) border.lean = x.tail<2>();
  return border;
}

// Place, width and lean of a hole.
using HoleNumbers = Eigen::Matrix<double, 5, 1>;
HoleNumbers NumbersOf(const OpeningBorder& hole) {
  HoleNumbers numbers;
  numbers << hole.middle_mm, hole.width_mm, hole.lean;
  return numbers;
}

// A border of one shape.
struct ShapeFit {
  FittedOpening fitted;
  // Of the shape, wherever and however large it is; nothing where a walk found no way.
  double log_evidence = -std::numeric_limits<double>::infinity();
  // Of the numbers of a hole; one that is radial has no variance of its lean.
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
  Posterior walked;  // over which walks may go on

  // How many sigma the drill is from radial.
  double LeansSigmas() const {
    const Eigen::Vector2d lean = fitted.border.lean;
    if (lean.isZero()) return 0;
    const Eigen::Vector2d solved = SolveSymmetric(covariance.bottomRightCorner<2, 2>(), lean);
    return std::sqrt(std::max(0.0, lean.dot(solved)));
  }
  // Of a hole: with what is known of it.
  void Take(const HoleNumbers& numbers) {
    OpeningBorder &border = fitted.border, &sigma = fitted.sigma;
    border.middle_mm = numbers.head<2>();
    border.length_mm = border.width_mm = numbers[2];
    border.lean = numbers.tail<2>();
    const HoleNumbers sigmas = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
    sigma.middle_mm = sigmas.head<2>();
    sigma.length_mm = sigma.width_mm = sigmas[2];
    sigma.lean = sigmas.tail<2>();
  }
};

// A lean moves what a drill leaves of a round wall, by how far the wall sags over it, and makes it
// larger: round the tube by three times what its form tells of the lean. So a leaning hole is
// walked over by where and how large a round one would be that leaves as much, which hardly depends
// on how much it leans.
class LeanMoves {
 public:
  explicit LeanMoves(const OpeningBorder& about) {
    const double sag_mm = about.width_mm * about.width_mm / (16.0 * about.pipe_radius_mm);
    by_mm_ = {0.5 * sag_mm, 1.5 * sag_mm};
  }
  // The numbers of a walk from those of a border, and back.
  Eigen::VectorXd Walked(const Eigen::VectorXd& x) const {
    Eigen::VectorXd walked = x;
    walked.head<2>() -= by_mm_.cwiseProduct(x.tail<2>());
    walked[2] /= Narrower(x.tail<2>().squaredNorm());
    return walked;
  }
  Eigen::VectorXd Border(const Eigen::VectorXd& walked) const {
    Eigen::VectorXd x = walked;
    x.head<2>() += by_mm_.cwiseProduct(walked.tail<2>());
    x[2] *= Narrower(walked.tail<2>().squaredNorm());
    return x;
  }
  static double Narrower(double lean2) { return std::pow(1.0 + lean2, -0.25); }
  // What is known of the border's numbers; of the square of the lean it needs the mean and the
  // variance, as of numbers that are normal.
  Posterior Border(const Posterior& walked) const {
    const Eigen::Vector2d lean = walked.mean.tail<2>();
    const Eigen::Matrix2d known = walked.covariance.bottomRightCorner<2, 2>();
    const double lean2 = lean.squaredNorm() + known.trace();
    const double narrower = Narrower(lean2), half_mm = walked.mean[2];
    const double grows_mm = -0.25 * half_mm * narrower / (1.0 + lean2);  // the half width with it
    Eigen::MatrixXd moves = Eigen::MatrixXd::Identity(5, 5);
    moves(0, 3) = by_mm_.x();
    moves(1, 4) = by_mm_.y();
    moves(2, 2) = narrower;
    moves.block<1, 2>(2, 3) = 2.0 * grows_mm * lean.transpose();
    Posterior border = walked;
    border.mean.head<2>() += by_mm_.cwiseProduct(lean);
    border.mean[2] *= narrower;
    border.covariance = moves * walked.covariance * moves.transpose();
    border.covariance(2, 2) += 2.0 * grows_mm * grows_mm * known.squaredNorm();
    return border;
  }

 private:
  Eigen::Vector2d by_mm_;
};

// Of those that lean, before the scan: any amount of up to the usual is about as likely, and any
// direction. Were the two coordinates normal, little leans would hardly be thought of, and these
// are the ones that no scan tells.
double LogLean(double lean2) {
  constexpr double kUsual2 = kBorder.usual_lean * kBorder.usual_lean;
  constexpr double kLittle2 = kBorder.little_lean * kBorder.little_lean;
  static const double kLogAll =
      std::log(kBorder.usual_lean * std::pow(2.0 * std::numbers::pi, 1.5) * 0.5 *
               std::erfc(std::sqrt(0.5 * kLittle2 / kUsual2))) +
      0.5 * kLittle2 / kUsual2;
  return -0.5 * (lean2 / kUsual2 + std::log(lean2 + kLittle2)) - kLogAll;
}

class ShapeWalk {
 public:
  // `most_lean`: of a hole that leans.
  ShapeWalk(const OpeningLikelihood& wall, const OpeningBorder& about, Shape shape,
            double most_lean = kBorder.most_lean)
      : wall_(wall), about_(about), shape_(shape), most_lean_(most_lean) {}

  double LogDensity(const Eigen::VectorXd& walked, double blur) const {
    const Eigen::VectorXd x = leans() ? LeanMoves(about_).Border(walked) : walked;
    constexpr double kNever = -1e300;
    if (x[2] < 0.25 * about_.width_mm || x[2] > about_.width_mm) return kNever;
    // Where no sample was looked at, anything may be.
    if ((x.head<2>() - about_.middle_mm).norm() > about_.width_mm) return kNever;
    double log = 0;
    if (shape_ == Shape::kSlot) {
      if (x[3] < 0 || std::abs(x[4] - about_.axis_rad) > 0.5 * std::numbers::pi) return kNever;
      log -= std::log(0.5 * kBorder.usually_longer * about_.width_mm * std::numbers::pi /
                      kBorder.slots);
    }
    if (leans()) {
      const double lean = std::hypot(x[3], x[4]);
      // The opposite leans are walked over apart.
      if (lean > most_lean_ || x.tail<2>().dot(about_.lean) < 0) return kNever;
      log += LogLean(lean * lean);
      log += std::log(kBorder.leaning * LeanMoves::Narrower(lean * lean));
    } else if (shape_ == Shape::kHole) {
      log += std::log(1.0 - kBorder.leaning);
    }
    const OpeningBorder border = BorderOf(x, shape_, about_);
    if (shape_ == Shape::kSlot) {
      const Eigen::Vector2d half_mm = 0.5 * border.length_mm * border.Axis();
      if (!wall_.IsInZone(border.middle_mm + half_mm) ||
          !wall_.IsInZone(border.middle_mm - half_mm)) {
        return kNever;
      }
    }
    return log + wall_.Log(border, blur);
  }

  ShapeFit Fit(int walk) const {
    const int numbers = shape_ == Shape::kHole ? 3 : 5;
    Eigen::VectorXd start(numbers), scale(numbers);
    const double scale_mm = 0.02 * about_.width_mm;
    start.head<3>() << about_.middle_mm, 0.48 * about_.width_mm;
    scale.head<3>().setConstant(scale_mm);
    if (shape_ == Shape::kSlot) {
      start.tail<2>() << 0.5 * (about_.length_mm - about_.width_mm), about_.axis_rad;
      scale.tail<2>() << scale_mm, scale_mm / about_.length_mm;
    } else if (leans()) {
      start.tail<2>() = about_.lean;
      scale.tail<2>().setConstant(0.1);
      start = LeanMoves(about_).Walked(start);
    }
    if (is_long()) start = Lengthened(start);
    Posterior posterior{start, scale.array().square().matrix().asDiagonal(), 0.0};
    if (!wall_.has_missed() && !is_long()) {
      return Taken(Sample(posterior, walk, 1.0), true);
    }
    const int blurred_walk =
        shape_ == Shape::kSlot && wall_.has_missed() ? walk : kBorder.short_walk;
    for (const double blur : Blurs()) {
      const Posterior sharper = Sample(posterior, blurred_walk, blur);
      if (WentOn(sharper, posterior)) posterior = sharper;
    }
    return FitFrom(posterior, walk);
  }
  // From where another walk has been.
  ShapeFit FitFrom(const Posterior& rough, int walk) const {
    const Posterior sharp = Sample(rough, walk, 1.0);
    const bool is_sharp = WentOn(sharp, rough);
    return Taken(is_sharp ? sharp : rough, is_sharp);
  }

 private:
  // A sample in a slot parts what is empty, and no walk finds the way past it: the likeliest of
  // those that go on from where one was seen, at either end of it or at both.
  Eigen::VectorXd Lengthened(const Eigen::VectorXd& start) const {
    const double half_mm = start[3];
    const Eigen::Vector2d axis(std::cos(start[4]), std::sin(start[4]));
    Eigen::VectorXd likeliest = start;
    double most = LogDensity(start, 1.0);
    for (int first = 0; first <= kBorder.lengths; ++first) {
      for (int last = 0; last <= kBorder.lengths; ++last) {
        const double step_mm = kBorder.lengthened * about_.length_mm / kBorder.lengths;
        Eigen::VectorXd longer = start;
        longer.head<2>() += 0.5 * step_mm * (last - first) * axis;
        longer[3] = half_mm + 0.5 * step_mm * (last + first);
        // Where no sample was looked at nothing says that it goes on.
        const Eigen::Vector2d half = (longer[2] + longer[3]) * axis;
        const bool ends = wall_.HasSampleBeyond(longer.head<2>() + half, axis) &&
                          wall_.HasSampleBeyond(longer.head<2>() - half, -axis);
        if (!ends) continue;
        const double log = LogDensity(longer, 1.0);
        if (log > most) std::tie(most, likeliest) = std::make_tuple(log, longer);
      }
    }
    return likeliest;
  }
  // Of lines, whose rays are known to a hundredth of a millimetre, no step from afar would hit; of
  // scattered samples the sides of a slot each rest on one or two, and others are likely, too.
  std::vector<double> Blurs() const {
    if (wall_.has_missed()) return {kBorder.blurs.begin(), kBorder.blurs.end()};
    std::vector<double> blurs;
    for (const double part : kBorder.gaps) {
      if (const double blur = wall_.BlurOfGaps(part); blur > 1.0) blurs.push_back(blur);
    }
    return blurs;
  }
  bool leans() const { return shape_ == Shape::kLeaningHole; }
  bool is_long() const {
    return shape_ == Shape::kSlot && about_.length_mm > kBorder.long_slot * about_.width_mm;
  }
  Posterior Sample(const Posterior& from, int steps, double blur) const {
    return SamplePosterior(from, steps,
                           [&](const Eigen::VectorXd& x) { return LogDensity(x, blur); });
  }
  // `is_sharp`: it is walked over without a blur, as other shapes are that it is compared with.
  ShapeFit Taken(const Posterior& walked, bool is_sharp) const {
    const Posterior posterior = leans() ? LeanMoves(about_).Border(walked) : walked;
    const Eigen::MatrixXd& c = posterior.covariance;
    ShapeFit fit;
    fit.walked = walked;
    FittedOpening& fitted = fit.fitted;
    fitted.border = BorderOf(posterior.mean, shape_, about_);
    fitted.sigma.middle_mm = {posterior.Sigma(0), posterior.Sigma(1)};
    fitted.sigma.width_mm = 2.0 * posterior.Sigma(2);
    fitted.sigma.length_mm = fitted.sigma.width_mm;
    if (shape_ == Shape::kSlot) {
      fitted.sigma.length_mm = 2.0 * std::sqrt(std::max(0.0, c(2, 2) + c(3, 3) + 2.0 * c(2, 3)));
      fitted.sigma.axis_rad = posterior.Sigma(4);
    } else {
      HoleNumbers of_half;
      of_half << 1.0, 1.0, 2.0, 1.0, 1.0;
      const Eigen::Index n = c.rows();
      fit.covariance.topLeftCorner(n, n) =
          of_half.head(n).asDiagonal() * c * of_half.head(n).asDiagonal();
      fit.Take(NumbersOf(fitted.border));
    }
    const double log_evidence = walked.LogEvidence();
    if (is_sharp && std::isfinite(log_evidence)) fit.log_evidence = log_evidence;
    return fit;
  }

  const OpeningLikelihood& wall_;
  OpeningBorder about_;
  Shape shape_;
  double most_lean_;
};

// Leaning holes that leave about this oval: the shift of its middle is what the wall sags by under
// its border. The opposite lean leaves nearly the same, and a walk does not find the way from one
// to the other.
std::vector<OpeningBorder> LeansOf(const OpeningBorder& oval) {
  const double ratio = oval.length_mm / oval.width_mm;
  const double lean = std::min(0.9 * kBorder.most_lean, std::sqrt(ratio * ratio - 1.0));
  const double sag_mm = oval.width_mm * oval.width_mm / (16.0 * oval.pipe_radius_mm);
  std::vector<OpeningBorder> leans;
  for (const double side : {-1.0, 1.0}) {
    OpeningBorder round = oval;
    round.length_mm = round.width_mm;
    round.lean = side * lean * oval.Axis();
    round.middle_mm += sag_mm * round.lean;
    leans.push_back(round);
  }
  return leans;
}

const ShapeFit& Likeliest(std::span<const ShapeFit> fits) {
  return *std::max_element(fits.begin(), fits.end(), [](const ShapeFit& a, const ShapeFit& b) {
    return a.log_evidence < b.log_evidence;
  });
}

// What of a hole is known where any of `fits` may be true, by their odds. `told`: that it is told
// as; else it is their mean.
ShapeFit Doubted(std::span<const ShapeFit> fits, const std::optional<ShapeFit>& told) {
  const ShapeFit& likeliest = Likeliest(fits);
  std::vector<double> odds;
  double all_odds = 0;
  HoleNumbers mean = HoleNumbers::Zero();
  for (const ShapeFit& fit : fits) {
    odds.push_back(std::exp(fit.log_evidence - likeliest.log_evidence));
    all_odds += odds.back();
    mean += odds.back() * NumbersOf(fit.fitted.border);
  }
  mean /= all_odds;
  if (told) mean = NumbersOf(told->fitted.border);
  ShapeFit doubted = likeliest;
  doubted.log_evidence += std::log(all_odds);
  doubted.covariance.setZero();
  for (std::size_t i = 0; i < fits.size(); ++i) {
    const HoleNumbers off = NumbersOf(fits[i].fitted.border) - mean;
    doubted.covariance += odds[i] / all_odds * (fits[i].covariance + off * off.transpose());
  }
  doubted.Take(mean);
  return doubted;
}

// The most that a drill may lean which leaves an oval no longer than what samples leave free: a
// dent beside a hole takes samples away as a lean by far more would.
double MostLeanOf(const FittedOpening& oval) {
  const double longest = kBorder.longer_oval *
                         (oval.border.length_mm + kBorder.oval_most * oval.sigma.length_mm) /
                         oval.border.width_mm;
  return std::min(kBorder.most_lean, std::sqrt(std::max(0.0, longest * longest - 1.0)));
}

// What leaning holes there may be. `abouts`: where.
std::vector<ShapeFit> FitLeans(const OpeningLikelihood& wall, std::span<const OpeningBorder> abouts,
                               double most_lean) {
  std::vector<ShapeFit> fits;
  for (const OpeningBorder& about : abouts) {
    const ShapeWalk leaning(wall, about, Shape::kLeaningHole, most_lean);
    ShapeFit fit = leaning.Fit(kBorder.short_walk);
    if (fit.LeansSigmas() > kBorder.may_lean) {
      fit = leaning.FitFrom(fit.walked, kBorder.lean_walk);
    }
    // One that would lean by more than samples allow was led there by something else.
    const bool may_be = fit.fitted.border.lean.norm() < kBorder.no_more * most_lean;
    if (may_be && std::isfinite(fit.log_evidence)) fits.push_back(fit);
  }
  return fits;
}

// A hole of which any of `fits` may be true: as its drill leans, where that is certain, or as if it
// were radial, with the doubt of how it leans. `may_tell`: the lean.
ShapeFit HoleOf(std::span<const ShapeFit> fits, bool may_tell) {
  const ShapeFit& likeliest = Likeliest(fits);
  ShapeFit round = Doubted(fits, std::nullopt);
  const double part = std::exp(likeliest.log_evidence - round.log_evidence);
  if (may_tell && part > kBorder.sure_lean && likeliest.LeansSigmas() > kBorder.lean_sigmas) {
    return Doubted(fits, likeliest);
  }
  // What is told as radial may lean by as much as it seemed to, and as the samples leave open.
  Eigen::Vector2d &lean = round.fitted.border.lean, &sigma = round.fitted.sigma.lean;
  sigma = (sigma.cwiseAbs2() + lean.cwiseAbs2()).cwiseSqrt();
  lean.setZero();
  return round;
}

// What a drill that leans leaves of a round wall, as seen along the normal: of a flat one it would
// be an ellipse, each place of which lies as far aside as the wall there is lower.
double LeaningAreaMm2(const OpeningBorder& border) {
  constexpr int kPlaces = 32, kRounds = 6;
  constexpr double kExact = 1e-4;  // of the pipe's radius
  static const auto kTurns = [] {
    std::array<Eigen::Vector2d, kPlaces> turns;
    for (int i = 0; i < kPlaces; ++i) {
      const double turn = 2.0 * std::numbers::pi * i / kPlaces;
      turns[static_cast<std::size_t>(i)] = {std::cos(turn), std::sin(turn)};
    }
    return turns;
  }();
  const double r_mm = border.pipe_radius_mm, half_mm = 0.5 * border.width_mm;
  const auto height = [&](double y_mm) {
    return std::sqrt(std::max(0.0, r_mm * r_mm - y_mm * y_mm));
  };
  const double tan = border.lean.norm(), stretched_mm = half_mm * std::sqrt(1.0 + tan * tan);
  const Eigen::Vector2d along = border.lean / tan, across(-along.y(), along.x());
  const double middle_up = height(border.middle_mm.y());
  Eigen::Vector2d first = Eigen::Vector2d::Zero(), last = first;
  double twice_mm2 = 0;
  for (int i = 0; i < kPlaces; ++i) {
    const Eigen::Vector2d& turn = kTurns[static_cast<std::size_t>(i)];
    const Eigen::Vector2d flat = stretched_mm * turn.x() * along + half_mm * turn.y() * across;
    double up = 0;
    for (int round = 0; round < kRounds; ++round) {
      const double before = up;
      up = height(border.middle_mm.y() + flat.y() + border.lean.y() * up) - middle_up;
      if (std::abs(up - before) < kExact * r_mm) break;
    }
    const Eigen::Vector2d place = flat + up * border.lean;
    if (i > 0) twice_mm2 += last.x() * place.y() - last.y() * place.x();
    if (i == 0) first = place;
    last = place;
  }
  twice_mm2 += last.x() * first.y() - last.y() * first.x();
  // A polygon of so many corners lacks this part of a round place's area.
  constexpr double kStep = 2.0 * std::numbers::pi / kPlaces;
  return 0.5 * twice_mm2 * kStep / std::sin(kStep);
}

}  // namespace

double OpeningBorder::DistanceMm(const Eigen::Vector2d& place_mm) const {
  const Eigen::Vector2d from = place_mm - middle_mm;
  if (!lean.isZero()) {
    const auto height = [this](double y) {
      return std::sqrt(std::max(0.0, pipe_radius_mm * pipe_radius_mm - y * y));
    };
    const double up = height(place_mm.y()) - height(middle_mm.y());
    // Across the drill's axis (lean, 1).
    const double square = from.squaredNorm() + up * up;
    const double out = (from.dot(lean) + up) / std::sqrt(1.0 + lean.squaredNorm());
    return std::sqrt(std::max(0.0, square - out * out)) - 0.5 * width_mm;
  }
  if (is_hole()) return from.norm() - 0.5 * width_mm;
  const Eigen::Vector2d axis = Axis();
  const double along = std::abs(from.dot(axis)) - 0.5 * (length_mm - width_mm);
  const double across = axis.x() * from.y() - axis.y() * from.x();
  return std::hypot(std::max(0.0, along), across) - 0.5 * width_mm;
}

double OpeningBorder::AreaMm2() const {
  if (is_hole() && !lean.isZero() && pipe_radius_mm > 0) return LeaningAreaMm2(*this);
  return (0.25 * std::numbers::pi * width_mm * width_mm + (length_mm - width_mm) * width_mm) *
         std::sqrt(1.0 + lean.squaredNorm());
}

SampleDensity DensityBeside(const OpeningBorder& border, std::span<const Eigen::Vector2d> wall) {
  const double to_mm = 0.4 * border.width_mm;
  double count = 0;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  Eigen::Matrix2d square = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& place : wall) {
    const double off_mm = border.DistanceMm(place);
    if (!(off_mm > 0 && off_mm < to_mm)) continue;
    const Eigen::Vector2d from = place - border.middle_mm;
    count += 1;
    mean += from;
    square += from * from.transpose();
  }
  OpeningBorder wider = border;
  wider.width_mm += 2.0 * to_mm;
  wider.length_mm += 2.0 * to_mm;
  SampleDensity density;
  density.per_mm2 = count / (wider.AreaMm2() - border.AreaMm2());
  if (square(0, 0) * square(1, 1) > square(0, 1) * square(1, 0)) {
    density.slope = SolveSymmetric(square, mean);
  }
  // No side has fewer than none.
  const double most = 1.8 / border.length_mm;
  if (density.slope.norm() > most) density.slope *= most / density.slope.norm();
  return density;
}

FittedOpening FitOpening(std::span<const Eigen::Vector2d> samples, const OpeningBorder& about,
                         double smear_mm, std::span<const MissedPlace> missed,
                         std::span<const Eigen::Vector2d> scattered) {
  const OpeningLikelihood wall(samples, missed, scattered, about, smear_mm);
  const ShapeFit slot = ShapeWalk(wall, about, Shape::kSlot).Fit(kBorder.walk);
  const OpeningBorder& long_one = slot.fitted.border;
  const double longer_mm = long_one.length_mm - long_one.width_mm;
  const double sigma_mm = std::hypot(slot.fitted.sigma.length_mm, slot.fitted.sigma.width_mm);
  const bool is_long = longer_mm > kBorder.slot_sigmas * sigma_mm &&
                       longer_mm > kBorder.slot_part * long_one.width_mm;
  if (is_long) {
    // A drill that leans along the long axis leaves an oval, too, no longer than leans allow.
    const bool may_lean =
        long_one.length_mm < std::hypot(1.0, kBorder.most_lean) * long_one.width_mm;
    if (!may_lean || !(about.pipe_radius_mm > 0)) return slot.fitted;
    const std::vector<ShapeFit> leans = FitLeans(wall, LeansOf(long_one), MostLeanOf(slot.fitted));
    if (leans.empty()) return slot.fitted;
    const ShapeFit hole = HoleOf(leans, !about.is_bent);
    return hole.log_evidence > slot.log_evidence ? hole.fitted : slot.fitted;
  }
  OpeningBorder round = long_one;
  round.width_mm = round.length_mm = std::sqrt(long_one.AreaMm2() * 4.0 / std::numbers::pi);
  const ShapeFit hole = ShapeWalk(wall, round, Shape::kHole).Fit(kBorder.walk);
  if (!(about.pipe_radius_mm > 0) || !std::isfinite(hole.log_evidence)) return hole.fitted;
  const bool is_oval = longer_mm > kBorder.oval_sigmas * sigma_mm;
  std::vector<ShapeFit> fits = FitLeans(
      wall, is_oval ? LeansOf(long_one) : std::vector{hole.fitted.border}, MostLeanOf(slot.fitted));
  fits.push_back(hole);
  return HoleOf(fits, !about.is_bent).fitted;
}

}  // namespace bendloop::pipeline
