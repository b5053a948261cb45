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
#include "tests/bench/bench_table.h"
#include "tests/bench/cut_scan.h"
#include "tests/bench/live_cuts.h"
#include "tests/support/cut_walls.h"
#include "tests/support/reversed_features.h"

namespace bendloop::bench {
namespace {

using pipeline::OpeningBorder;

constexpr double kPipeRadiusMm = kCutPipeRadiusMm;

// Mean squares of a number's errors over its bound and over its own sigma.
struct Score {
  double over_bound = 0, over_sigma = 0, bound = 0, count = 0;

  void Add(double error, double least, double sigma) {
    over_bound += std::pow(error / least, 2);
    over_sigma += std::pow(error / sigma, 2);
    bound += least;
    count += 1;
  }
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

void ScoreCuts(const pipeline::Measurement& m, hal::TubeFeatures truth, const hal::Tube& tube,
               Scores& scores) {
  const auto& rows = m.tube.program.rows;
  // Whichever end came first.
  const bool is_reversed = std::abs(rows.front().angle_deg - 45) < 5;
  if (is_reversed) truth = tests::ReversedFeatures(truth, tube);
  for (const bool at_start : {true, false}) {
    const auto& end = at_start ? m.features.first_end : m.features.last_end;
    const hal::EndCut& cut = at_start ? truth.first_end : truth.last_end;
    if (!end) continue;
    Of(scores, "end: obliquity deg")
        .Add(end->cut.obliquity_deg - cut.obliquity_deg, 1, end->obliquity_sigma_deg);
    Of(scores, "end: longest at deg")
        .Add(Turn(end->cut.around_deg, cut.around_deg), 1, end->around_sigma_deg);
  }
  Of(scores, "end: length mm")
      .Add(rows.front().length_mm - (is_reversed ? 80 : 90), 1, m.sigma.rows.front().length_mm);
  Of(scores, "end: length mm")
      .Add(rows.back().length_mm - (is_reversed ? 90 : 80), 1, m.sigma.rows.back().length_mm);
  const double length_mm = hal::SpineLength(m.tube.program);
  const double true_mm = 90 + 70 + 80 + 25 * 105 * hal::kRadiansPerDegree;
  for (const hal::WallOpening& opening : truth.openings) {
    const auto found = std::min_element(m.features.openings.begin(), m.features.openings.end(),
                                        [&](const auto& a, const auto& b) {
                                          return std::abs(a.opening.along_mm - opening.along_mm) <
                                                 std::abs(b.opening.along_mm - opening.along_mm);
                                        });
    const bool is_found = found != m.features.openings.end() &&
                          std::abs(found->opening.along_mm - opening.along_mm) < 3 &&
                          found->opening.is_hole() == opening.is_hole();
    Of(scores, opening.is_hole() ? "hole: not found" : "slot: not found")
        .Add(is_found ? 0 : 1, 1, 1);
    if (!is_found) continue;
    const hal::WallOpening &is = found->opening, &sigma = found->sigma;
    const bool from_end = opening.along_mm > 0.5 * true_mm;
    const std::string kind = opening.is_hole() ? "hole" : "slot";
    Of(scores, kind + ": along mm")
        .Add(is.along_mm - opening.along_mm - (from_end ? length_mm - true_mm : 0), 1,
             sigma.along_mm);
    Of(scores, kind + ": around deg")
        .Add(Turn(is.around_deg, opening.around_deg), 1, sigma.around_deg);
    Of(scores, kind + ": width mm").Add(is.width_mm - opening.width_mm, 1, sigma.width_mm);
    if (opening.is_hole()) continue;
    Of(scores, "slot: length mm").Add(is.length_mm - opening.length_mm, 1, sigma.length_mm);
    Of(scores, "slot: axis deg")
        .Add(std::remainder(is.axis_deg - opening.axis_deg, 180.0), 1, sigma.axis_deg);
  }
  Of(scores, "dent: not found").Add(m.dents.size() == 1 ? 0 : 1, 1, 1);
  if (m.dents.size() != 1) return;
  const pipeline::DentFound& dent = m.dents.front();
  const hal::PressedDent& pressed = truth.dents.front();
  const double longer_mm = 2 * pressed.along_mm > true_mm ? length_mm - true_mm : 0;
  Of(scores, "dent: along mm")
      .Add(dent.along_mm - pressed.along_mm - longer_mm, 1, dent.along_sigma_mm);
  Of(scores, "dent: around deg")
      .Add(Turn(dent.around_deg, pressed.around_deg), 1, dent.around_sigma_deg);
  Of(scores, "dent: depth mm").Add(dent.depth_mm - pressed.depth_mm, 1, dent.sigma_mm);
  Of(scores, "dent: area mm2")
      .Add(dent.area_mm2 -
               2 * std::numbers::pi * std::numbers::ln2 * pressed.width_mm * pressed.width_mm,
           1, dent.area_sigma_mm2);
}

void PrintScans(std::uint64_t seed, int count) {
  std::vector<std::vector<std::string>> lines = {
      {"lines mm apart", "what", "rms error", "error over sigma"}};
  for (const double spacing_mm : {0.5, 1.0}) {
    Scores scores;
    for (int i = 0; i < count; ++i) {
      const CutScan scanned = ACutTube(seed + static_cast<std::uint64_t>(i), spacing_mm);
      const auto measurement = Measure(scanned);
      if (measurement && measurement->tube.program.rows.size() == 3)
        ScoreCuts(*measurement, scanned.options.features, scanned.tube, scores);
    }
    for (const auto& [name, score] : scores) {
      lines.push_back({Number(spacing_mm), name, score.OverBound(), score.OverSigma()});
    }
  }
  PrintMarkdown(std::cout, "Scans by laser lines", lines, {true, false, true, true});
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  int count = 200, scans = 40, live = 0;
  std::uint64_t seed = 1;
  bool told = false;
  std::string plot;
  CLI::App app("Errors of ends, holes and slots beside the least that samples allow");
  app.add_option("--count", count, "Borders of each kind")->capture_default_str();
  app.add_option("--scans", scans, "Tubes scanned by laser lines")->capture_default_str();
  app.add_option("--live", live, "Random tubes scanned by hand")->capture_default_str();
  app.add_option("--seed", seed, "Of the first of all these")->capture_default_str();
  app.add_flag("--told", told, "Say of these what is not found or more than 3 sigma off");
  app.add_option("--plot", plot, "Draw borders found, of a handle and of a tube, into this SVG");
  CLI11_PARSE(app, argc, argv);
  if (!plot.empty()) bendloop::bench::DrawBorders(plot);
  if (count > 0) bendloop::bench::PrintScattered(seed, count);
  if (scans > 0) bendloop::bench::PrintScans(seed, scans);
  if (live > 0) bendloop::bench::PrintLive(seed, live, told);
}
