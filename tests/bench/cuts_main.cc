// SPDX-License-Identifier: Apache-2.0
// What is cut into tubes and drilled through their walls: errors of ends, holes and slots beside
// the least that their samples allow, and what 1 sigma of laser-line scans is worth.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "hal/tube_features.h"
#include "pipeline/features/end_plane_fit.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/cut_scan.h"
#include "tests/bench/live_cuts.h"
#include "tests/bench/ray_bound.h"
#include "tests/support/cut_walls.h"
#include "tests/support/reversed_features.h"

namespace bendloop::bench {
namespace {

using pipeline::OpeningBorder;

constexpr double kPipeRadiusMm = kCutPipeRadiusMm;

// Mean squares of a number's errors over its bound and over its own sigma.
struct Score {
  double over_bound = 0, over_sigma = 0, bound = 0, count = 0;
  double bounded = 0, errors = 0, bounds = 0;  // of scans: those with a bound, and squares of both

  void Add(double error, double least, double sigma) {
    over_bound += std::pow(error / least, 2);
    over_sigma += std::pow(error / sigma, 2);
    bound += least;
    count += 1;
  }
  // Of a scan, whose bound is its own; none: nan.
  void AddScanned(double error, double sigma, double least = NAN) {
    Add(error, 1, sigma);
    if (!std::isfinite(least)) return;
    bounded += 1;
    errors += error * error;
    bounds += least * least;
  }
  std::string OverBounds() const { return bounded > 0 ? Number(std::sqrt(errors / bounds)) : "-"; }
  std::string Bounds() const { return bounded > 0 ? Number(std::sqrt(bounds / bounded)) : "-"; }
  std::string OverBound() const { return Number(std::sqrt(over_bound / count)); }
  std::string OverSigma() const { return Number(std::sqrt(over_sigma / count)); }
  std::string Bound() const { return Number(bound / count); }
};
using Scores = std::vector<std::pair<std::string, Score>>;

Score& Of(Scores& scores, const std::string& name) {
  for (auto& [known, score] : scores) {
    if (known == name) return score;
  }
  return scores.emplace_back(name, Score{}).second;
}

// Ends cut square and 3 degrees oblique.
void ScoreEnds(std::uint64_t seed, double per_mm2, double smear_mm, int count, Scores& scores) {
  std::mt19937_64 random(seed);
  const double window_mm = 3 * kPipeRadiusMm;
  for (int i = 0; i < count; ++i) {
    const double obliquity = i % 2 == 0 ? 3.0 * hal::kRadiansPerDegree : 0.0;
    const tests::CutTube tube{kPipeRadiusMm, tests::Uniform(random, -1, 1), std::tan(obliquity),
                              tests::Uniform(random, -3, 3)};
    const auto plane =
        pipeline::FitEndPlane(tests::SampleEnd(tube, window_mm, per_mm2, smear_mm, random),
                              kPipeRadiusMm, window_mm, 2 * smear_mm);
    if (!plane) continue;
    const double bound_mm = tube.BoundMm(per_mm2, smear_mm);
    const double bound = std::sqrt(2.0) * bound_mm / kPipeRadiusMm;
    Of(scores, "end: place mm").Add(plane->at_mm - tube.at_mm, bound_mm, plane->at_sigma_mm);
    for (const double off : {plane->cosine - tube.slope * std::cos(tube.around_rad),
                             plane->sine - tube.slope * std::sin(tube.around_rad)}) {
      Of(scores, "end: obliquity deg")
          .Add(off * hal::kDegreesPerRadian, bound * hal::kDegreesPerRadian,
               plane->slope_sigma * hal::kDegreesPerRadian);
    }
  }
}

void ScoreOpening(std::uint64_t seed, const std::string& name, OpeningBorder truth, int numbers,
                  double per_mm2, double smear_mm, int count, Scores& scores) {
  std::mt19937_64 random(seed + 1);
  truth.pipe_radius_mm = kPipeRadiusMm;
  const Eigen::VectorXd bound = tests::OpeningBound(truth, numbers, per_mm2, smear_mm);
  for (int i = 0; i < count; ++i) {
    OpeningBorder about = truth;
    about.lean.setZero();
    about.middle_mm.x() += 0.1;
    about.length_mm += 0.4 + truth.width_mm * (std::sqrt(1 + truth.lean.squaredNorm()) - 1);
    about.width_mm += 0.2;
    if (!truth.lean.isZero()) about.axis_rad = std::atan2(truth.lean.y(), truth.lean.x());
    const auto fitted =
        pipeline::FitOpening(tests::SampleWall(truth, per_mm2, smear_mm, random), about, smear_mm);
    const OpeningBorder &border = fitted.border, &sigma = fitted.sigma;
    const bool is_right =
        border.is_hole() == truth.is_hole() && border.lean.isZero() == truth.lean.isZero();
    Of(scores, name + ": taken for another %").Add(is_right ? 0 : 1, 1, 1);
    if (!is_right) continue;
    for (int k = 0; k < 2; ++k) {
      Of(scores, name + ": place mm")
          .Add(border.middle_mm[k] - truth.middle_mm[k], bound[k], sigma.middle_mm[k]);
    }
    Of(scores, name + (truth.is_hole() ? ": diameter mm" : ": width mm"))
        .Add(border.width_mm - truth.width_mm, bound[2], sigma.width_mm);
    if (!truth.is_hole()) {
      Of(scores, name + ": length mm")
          .Add(border.length_mm - truth.length_mm, bound[3], sigma.length_mm);
      Of(scores, name + ": axis deg")
          .Add((border.axis_rad - truth.axis_rad) * hal::kDegreesPerRadian,
               bound[4] * hal::kDegreesPerRadian, sigma.axis_rad * hal::kDegreesPerRadian);
    } else if (numbers == 5) {
      for (int k = 0; k < 2; ++k) {
        Of(scores, name + ": lean")
            .Add(border.lean[k] - truth.lean[k], bound[3 + k], sigma.lean[k]);
      }
    }
  }
}

Scores ScoreScattered(std::uint64_t seed, double per_mm2, double smear_mm, int count) {
  Scores scores;
  ScoreEnds(seed, per_mm2, smear_mm, count, scores);
  OpeningBorder hole;
  hole.length_mm = hole.width_mm = 6;
  ScoreOpening(seed, "hole 6 mm", hole, 3, per_mm2, smear_mm, count, scores);
  OpeningBorder leaning = hole;
  leaning.lean = {0.2, 0.5};
  ScoreOpening(seed, "hole 6 mm, leaning 28 deg", leaning, 5, per_mm2, smear_mm, count, scores);
  OpeningBorder slot = hole;
  slot.length_mm = 12, slot.width_mm = 5, slot.axis_rad = 0.4;
  ScoreOpening(seed, "slot 12 x 5 mm", slot, 5, per_mm2, smear_mm, count, scores);
  return scores;
}

void PrintScattered(std::uint64_t seed, int count) {
  std::vector<std::vector<std::string>> lines = {
      {"noise mm", "samples a mm2", "what", "bound", "error over bound", "error over sigma"}};
  for (const auto& [noise_mm, per_mm2] :
       std::vector<std::pair<double, double>>{{0.01, 200}, {0.05, 40}, {0.1, 20}, {0.05, 6}}) {
    for (const auto& [name, score] : ScoreScattered(seed, per_mm2, 0.5 * noise_mm, count)) {
      lines.push_back({Number(noise_mm), Number(per_mm2), name, score.Bound(), score.OverBound(),
                       score.OverSigma()});
    }
  }
  PrintMarkdown(std::cout, "Scattered samples beside the Cramer-Rao bound", lines,
                {true, true, false, true, true, true});
}

double Turn(double a_deg, double b_deg) { return std::remainder(a_deg - b_deg, 360.0); }

// Ends in the order of the measurement, each with what the scan's rays let of it.
void ScoreScannedEnds(const CutScan& scanned, const pipeline::Measurement& m,
                      const hal::TubeFeatures& truth, bool is_reversed, Scores& scores) {
  const double true_mm[2] = {is_reversed ? 80.0 : 90.0, is_reversed ? 90.0 : 80.0};
  const auto& rows = m.tube.program.rows;
  for (const bool at_start : {true, false}) {
    const Eigen::Vector3d bound = RayBound(scanned, at_start != is_reversed);
    const auto& end = at_start ? m.features.first_end : m.features.last_end;
    const hal::EndCut& cut = at_start ? truth.first_end : truth.last_end;
    const double length_mm = at_start ? rows.front().length_mm : rows.back().length_mm;
    const double sigma_mm =
        at_start ? m.sigma.rows.front().length_mm : m.sigma.rows.back().length_mm;
    Of(scores, "end: length mm")
        .AddScanned(length_mm - true_mm[at_start ? 0 : 1], sigma_mm, bound[0]);
    if (!end) continue;
    const double around = bound[2] / std::tan(cut.obliquity_deg * hal::kRadiansPerDegree);
    Of(scores, "end: obliquity deg")
        .AddScanned(end->cut.obliquity_deg - cut.obliquity_deg, end->obliquity_sigma_deg,
                    bound[1] * hal::kDegreesPerRadian);
    Of(scores, "end: longest at deg")
        .AddScanned(Turn(end->cut.around_deg, cut.around_deg), end->around_sigma_deg,
                    around * hal::kDegreesPerRadian);
  }
}

void ScoreScannedOpening(const pipeline::OpeningFound& found, const hal::WallOpening& truth,
                         double longer_mm, const Eigen::VectorXd& bound, Scores& scores) {
  const hal::WallOpening &is = found.opening, &sigma = found.sigma;
  const std::string kind = truth.is_hole() ? "hole" : "slot";
  const auto least = [&](Eigen::Index i) { return i < bound.size() ? bound[i] : NAN; };
  Of(scores, kind + ": along mm")
      .AddScanned(is.along_mm - truth.along_mm - longer_mm, sigma.along_mm, least(0));
  Of(scores, kind + ": around deg")
      .AddScanned(Turn(is.around_deg, truth.around_deg), sigma.around_deg,
                  least(1) / kPipeRadiusMm * hal::kDegreesPerRadian);
  Of(scores, kind + ": width mm")
      .AddScanned(is.width_mm - truth.width_mm, sigma.width_mm, least(2));
  if (truth.is_hole()) return;
  Of(scores, "slot: length mm")
      .AddScanned(is.length_mm - truth.length_mm, sigma.length_mm, least(3));
  Of(scores, "slot: axis deg")
      .AddScanned(std::remainder(is.axis_deg - truth.axis_deg, 180.0), sigma.axis_deg,
                  least(4) * hal::kDegreesPerRadian);
}

void ScoreScannedDents(const pipeline::Measurement& m, const hal::PressedDent& pressed,
                       double longer_mm, Scores& scores) {
  Of(scores, "dent: not found").AddScanned(m.dents.size() == 1 ? 0 : 1, 1);
  if (m.dents.size() != 1) return;
  const pipeline::DentFound& dent = m.dents.front();
  Of(scores, "dent: along mm")
      .AddScanned(dent.along_mm - pressed.along_mm - longer_mm, dent.along_sigma_mm);
  Of(scores, "dent: around deg")
      .AddScanned(Turn(dent.around_deg, pressed.around_deg), dent.around_sigma_deg);
  Of(scores, "dent: depth mm").AddScanned(dent.depth_mm - pressed.depth_mm, dent.sigma_mm);
  Of(scores, "dent: area mm2")
      .AddScanned(dent.area_mm2 - 2 * std::numbers::pi * std::numbers::ln2 * pressed.width_mm *
                                      pressed.width_mm,
                  dent.area_sigma_mm2);
}

void ScoreCuts(const CutScan& scanned, const pipeline::Measurement& m, Scores& scores) {
  const auto& openings = scanned.options.features.openings;
  // Whichever end came first.
  const bool is_reversed = std::abs(m.tube.program.rows.front().angle_deg - 45) < 5;
  const hal::TubeFeatures truth =
      is_reversed ? tests::ReversedFeatures(scanned.options.features, scanned.tube)
                  : scanned.options.features;
  ScoreScannedEnds(scanned, m, truth, is_reversed, scores);
  const double true_mm = hal::SpineLength(scanned.tube.program);
  const double longer_mm = hal::SpineLength(m.tube.program) - true_mm;
  for (std::size_t i = 0; i < truth.openings.size(); ++i) {
    const hal::WallOpening& opening = truth.openings[i];
    const double shift_mm = opening.along_mm > 0.5 * true_mm ? longer_mm : 0;
    const auto found =
        std::find_if(m.features.openings.begin(), m.features.openings.end(), [&](const auto& of) {
          return std::abs(of.opening.along_mm - shift_mm - opening.along_mm) < 3 &&
                 of.opening.is_hole() == opening.is_hole();
        });
    const bool is_found = found != m.features.openings.end();
    Of(scores, opening.is_hole() ? "hole: not found" : "slot: not found")
        .AddScanned(is_found ? 0 : 1, 1);
    if (is_found) {
      ScoreScannedOpening(*found, opening, shift_mm, RayBound(scanned, openings[i]), scores);
    }
  }
  ScoreScannedDents(m, truth.dents.front(),
                    2 * truth.dents.front().along_mm > true_mm ? longer_mm : 0, scores);
}

void PrintScans(std::uint64_t seed, int count, double wall_mm) {
  std::vector<std::vector<std::string>> lines = {
      {"lines mm apart", "what", "rms error", "error over sigma", "bound", "error over bound"}};
  for (const double spacing_mm : {0.5, 1.0}) {
    Scores scores;
    for (int i = 0; i < count; ++i) {
      CutScan scanned = ACutTube(seed + static_cast<std::uint64_t>(i), spacing_mm);
      scanned.options.wall_mm = wall_mm;
      const auto measurement = Measure(scanned);
      if (measurement && measurement->tube.program.rows.size() == 3)
        ScoreCuts(scanned, *measurement, scores);
    }
    for (const auto& [name, score] : scores) {
      lines.push_back({Number(spacing_mm), name, score.OverBound(), score.OverSigma(),
                       score.Bounds(), score.OverBounds()});
    }
  }
  PrintMarkdown(std::cout, "Scans by laser lines", lines, {true, false, true, true, true, true});
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  int count = 200, scans = 40, live = 0;
  std::uint64_t seed = 1;
  double wall_mm = 0;
  bool told = false;
  std::string plot;
  CLI::App app("Errors of ends, holes and slots beside the least that samples allow");
  app.add_option("--count", count, "Borders of each kind")->capture_default_str();
  app.add_option("--scans", scans, "Tubes scanned by laser lines")->capture_default_str();
  app.add_option("--live", live, "Random tubes scanned by hand")->capture_default_str();
  app.add_option("--seed", seed, "Of the first of all these")->capture_default_str();
  app.add_option("--wall", wall_mm, "Of scanned tubes, seen where it is cut [mm]; 0: not seen")
      ->capture_default_str();
  app.add_flag("--told", told, "Say of these what is not found or more than 3 sigma off");
  app.add_option("--plot", plot, "Draw borders found, of a handle and of a tube, into this SVG");
  CLI11_PARSE(app, argc, argv);
  if (!plot.empty()) bendloop::bench::DrawBorders(plot);
  if (count > 0) bendloop::bench::PrintScattered(seed, count);
  if (scans > 0) bendloop::bench::PrintScans(seed, scans, wall_mm);
  if (live > 0) bendloop::bench::PrintLive(seed, live, wall_mm, told);
}
