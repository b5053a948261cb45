// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_curve.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "hal/angles.h"
#include "pipeline/features/end_series.h"
#include "pipeline/math/dense_solve.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct CurveSettings {
  // Turns of the last terms that are tried.
  std::array<int, 8> orders = {2, 3, 4, 5, 6, 8, 10, 12};
  // Twice the logarithm of the odds that it is no plane.
  double certain = 8.0;
  // [sigma] and [of the mean gap] How far it leaves the plane somewhere.
  double leaves_sigmas = 5.0, leaves_gaps = 0.4;
  // Of the sectors of the turn: so many tell of it, and no more than so many in a row do not.
  double least_seen = 0.75;
  std::size_t most_blind = 3;
  // Places of one sector say the same as often as not where laser lines cross it: they count as so
  // many of all.
  double independent = 0.5;
  // [of the mean gap] Sides are blurred by so much, one after the other: a series is no border of
  // its own, so none is taken for sharper than the last.
  std::array<double, 3> blurs = {0.3, 0.1, 0.05};
  int walk_of_number = 250;
  int rounds = 10;
  std::size_t places = 72;
};
constexpr CurveSettings kCurve;

// Least squares that leave out what lies far off.
struct RoughCurve {
  Eigen::VectorXd x;
  Eigen::MatrixXd matrix;  // of places that are off by 1 mm
  double square = 0;       // mean of what they are off
  double Bic(double places) const {
    return places * std::log(square) + static_cast<double>(x.size()) * std::log(places);
  }
};

[[gnu::noinline]] RoughCurve FitRoughly(std::span<const RoughEndPlace> places, int order,
                                        double gap_mm, double r_mm) {
  RoughCurve curve;
  const Eigen::VectorXd certainties = SeriesCertainties(order, r_mm);
  const double least = gap_mm * gap_mm / 12.0;
  double reach_mm = 2.0 * r_mm;
  curve.x = Eigen::VectorXd::Zero(1 + 2 * order);
  std::vector<double> at;
  for (const RoughEndPlace& place : places) at.push_back(place.at_mm);
  curve.x[0] = Median(at);
  for (int round = 0; round < kCurve.rounds; ++round) {
    curve.matrix = least * Eigen::MatrixXd(certainties.cwiseAbs2().asDiagonal());
    Eigen::VectorXd right = Eigen::VectorXd::Zero(curve.x.size());
    std::vector<double> off;
    double weights = 0;
    curve.square = 0;
    for (const RoughEndPlace& place : places) {
      const Eigen::VectorXd terms = SeriesAt(place.cosine, place.sine, order);
      const double residual = place.at_mm - terms.dot(curve.x);
      off.push_back(std::abs(residual));
      const double weight = std::pow(std::max(0.0, 1.0 - std::pow(residual / reach_mm, 2)), 2);
      curve.matrix += weight * terms * terms.transpose();
      right += weight * place.at_mm * terms;
      // One that is left out is as far off as that.
      curve.square += std::pow(std::min(std::abs(residual), reach_mm), 2);
      weights += 1.0;
    }
    curve.square = std::max(least, curve.square / weights);
    curve.x = SolveSymmetric(curve.matrix, right);
    reach_mm = std::max({4.0 * Median(off), 2.0 * gap_mm, 0.02 * r_mm});
  }
  return curve;
}

// The likelihood of a series, from all that the evidence says.
class CurveLikelihood {
 public:
  CurveLikelihood(const EndEvidence& evidence, int order, double blur_mm)
      : evidence_(evidence),
        hits_(1 + 2 * order, 0),
        missed_(1 + 2 * order, 0),
        stops_(1 + 2 * order, 0) {
    std::vector<const EndSide*> beyond, before;
    for (const EndSide& side : evidence.sides) {
      if (side.is_told) continue;
      (side.is_beyond || side.is_whole ? beyond : before).push_back(&side);
    }
    const auto add = [&](const std::vector<const EndSide*>& sides, Lanes& lanes) {
      lanes = Lanes(1 + 2 * order, static_cast<Eigen::Index>(sides.size()));
      for (std::size_t i = 0; i < sides.size(); ++i) {
        lanes.Set(static_cast<Eigen::Index>(i), SeriesAt(sides[i]->cosine, sides[i]->sine, order),
                  sides[i]->at_mm,
                  (sides[i]->is_beyond ? 1.0 : -1.0) / std::max(sides[i]->sigma_mm, blur_mm));
      }
    };
    add(beyond, hits_);
    add(before, missed_);
    stops_ = Lanes(1 + 2 * order, static_cast<Eigen::Index>(evidence.columns.size()));
    for (std::size_t i = 0; i < evidence.columns.size(); ++i) {
      const EndStop& stop = evidence.columns[i];
      stops_.Set(static_cast<Eigen::Index>(i), SeriesAt(stop.cosine, stop.sine, order),
                 stop.last_mm, 1.0 / stop.mean_gap_mm);
    }
  }
  double Log(const Eigen::VectorXd& x) {
    const double greatest = evidence_.lines_greatest;
    const double sum =
        LogOfHits(hits_.Clear(x, greatest)) + LogOfMisses(missed_.Clear(x, greatest));
    return evidence_.stops ? sum + evidence_.stops->Sum(stops_.Clear(x, 0.0)) : sum;
  }

 private:
  struct Lanes {
    Lanes(Eigen::Index numbers, Eigen::Index count)
        : terms(count, numbers), at(count), scale(count), clear(count) {}
    void Set(Eigen::Index i, const Eigen::VectorXd& row, double at_mm, double by) {
      terms.row(i) = row.transpose();
      at[i] = at_mm;
      scale[i] = by;
    }
    std::span<const double> Clear(const Eigen::VectorXd& x, double more) {
      clear = ((terms * x - at).array() * scale.array() + more).matrix();
      return {clear.data(), static_cast<std::size_t>(clear.size())};
    }
    Eigen::MatrixXd terms;
    Eigen::VectorXd at, scale, clear;
  };

  const EndEvidence& evidence_;
  Lanes hits_, missed_, stops_;
};

// Whether all of the turn tells of the border, but for narrow parts.
bool IsSeenAllRound(std::span<const RoughEndPlace> places) {
  EndSectors seen{};
  for (const RoughEndPlace& place : places) {
    seen[EndSectorOf(std::atan2(place.sine, place.cosine))] = true;
  }
  std::size_t blind = 0, most = 0;
  for (std::size_t i = 0; i < 2 * kEndSectors; ++i) {
    blind = seen[i % kEndSectors] ? 0 : blind + 1;
    most = std::max(most, blind);
  }
  const auto count = static_cast<double>(std::count(seen.begin(), seen.end(), true));
  return count >= kCurve.least_seen * static_cast<double>(kEndSectors) && most <= kCurve.most_blind;
}

EndEvidence WithoutHidden(EndEvidence evidence, const EndSectors& hidden) {
  const auto is_hidden = [&](double cosine, double sine) {
    return hidden[EndSectorOf(std::atan2(sine, cosine))];
  };
  std::vector<EndSide> seen;
  for (std::size_t i = 0; i + 1 < evidence.sides.size(); i += 2) {
    if (is_hidden(evidence.sides[i].cosine, evidence.sides[i].sine)) continue;
    seen.push_back(evidence.sides[i]);
    seen.push_back(evidence.sides[i + 1]);
  }
  evidence.sides = std::move(seen);
  std::erase_if(evidence.columns,
                [&](const EndStop& stop) { return is_hidden(stop.cosine, stop.sine); });
  return evidence;
}

// The rough curve whose terms the places pay for, of so many turns or more; order 1: a plane.
std::pair<int, RoughCurve> ChooseOrder(std::span<const RoughEndPlace> places, int least_order,
                                       double gap_mm, double independent, double r_mm) {
  const double count = independent * static_cast<double>(places.size());
  int best = least_order;
  RoughCurve of_least = FitRoughly(places, least_order, gap_mm, r_mm), curve;
  const double bic_of_least = of_least.Bic(count);
  double least = bic_of_least;
  for (const int order : kCurve.orders) {
    if (order <= least_order) continue;
    if (2.0 * (1 + 2 * order) > count) break;
    RoughCurve more = FitRoughly(places, order, gap_mm, r_mm);
    if (more.Bic(count) >= least) continue;
    least = more.Bic(count);
    best = order;
    curve = std::move(more);
  }
  if (bic_of_least - least < kCurve.certain) return {least_order, std::move(of_least)};
  return {best, std::move(curve)};
}

}  // namespace

double SteepestMm(const Posterior& curve) {
  const std::vector<BorderPlace> places = PlacesOf(curve);
  const double apart_rad = 2.0 * std::numbers::pi / static_cast<double>(places.size());
  double rise_mm = std::abs(places.front().beyond_mm - places.back().beyond_mm);
  for (std::size_t i = 1; i < places.size(); ++i) {
    rise_mm = std::max(rise_mm, std::abs(places[i].beyond_mm - places[i - 1].beyond_mm));
  }
  return rise_mm / apart_rad;
}

std::vector<BorderPlace> PlacesOf(const Posterior& curve) {
  const int order = OrderOf(curve.mean);
  std::vector<BorderPlace> places;
  for (std::size_t i = 0; i < kCurve.places; ++i) {
    const double around_deg = 360.0 * static_cast<double>(i) / static_cast<double>(kCurve.places);
    const double around = around_deg * hal::kRadiansPerDegree;
    Eigen::VectorXd terms = SeriesAt(std::cos(around), std::sin(around), order);
    terms.head<3>().setZero();
    places.push_back({std::remainder(around_deg, 360.0), terms.dot(curve.mean),
                      std::sqrt(std::max(0.0, terms.dot(curve.covariance * terms)))});
  }
  return places;
}

std::optional<Posterior> FitEndCurve(const EndEvidence& all, const Eigen::VectorXd& about_mm,
                                     const EndSectors& hidden, double pipe_radius_mm) {
  const EndEvidence evidence = WithoutHidden(all, hidden);
  const std::vector<RoughEndPlace> places = evidence.RoughPlaces();
  if (!(evidence.gap_mm > 0) || !IsSeenAllRound(places)) return std::nullopt;
  const bool are_lines = evidence.share_lines || evidence.columns_of_line > 1.0 ||
                         evidence.sides.size() > evidence.columns.size();
  const auto [order, rough] = ChooseOrder(places, OrderOf(about_mm), evidence.gap_mm,
                                          are_lines ? kCurve.independent : 1.0, pipe_radius_mm);
  if (order == 1) return std::nullopt;
  const Eigen::VectorXd certainties = SeriesCertainties(order, pipe_radius_mm);
  Eigen::VectorXd about = Eigen::VectorXd::Zero(rough.x.size());
  about.head(about_mm.size()) = about_mm;
  Posterior curve{rough.x, rough.square * Inverse(rough.matrix)};
  const int walk = kCurve.walk_of_number * static_cast<int>(rough.x.size());
  WalkDice dice(rough.x.size());
  for (const double blur : kCurve.blurs) {
    CurveLikelihood likelihood(evidence, order, blur * evidence.gap_mm);
    curve = SamplePosterior(curve, walk, dice, [&](const Eigen::VectorXd& x) {
      return likelihood.Log(x) - 0.5 * (x + about).cwiseProduct(certainties).squaredNorm();
    });
  }
  curve.mean += about;
  const std::vector<BorderPlace> border = PlacesOf(curve);
  const bool leaves = std::any_of(border.begin(), border.end(), [&](const BorderPlace& place) {
    return std::abs(place.beyond_mm) > kCurve.leaves_sigmas * place.sigma_mm &&
           std::abs(place.beyond_mm) > kCurve.leaves_gaps * evidence.gap_mm;
  });
  return leaves ? std::optional(curve) : std::nullopt;
}

}  // namespace bendloop::pipeline
