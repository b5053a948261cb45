// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/live_cuts.h"

#include <algorithm>
#include <cmath>
#include <iostream>
#include <numbers>
#include <random>
#include <vector>

#include "hal/angles.h"
#include "hal/spine.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/ray_bound.h"
#include "tests/support/reversed_features.h"
#include "tests/support/uniform.h"

namespace bendloop::bench {
namespace {

using tests::LogUniform;
using tests::Uniform;

double Turn(double a_deg, double b_deg) { return std::remainder(a_deg - b_deg, 360.0); }

// Of one number: how often it was told, its errors in sigmas and how many are beyond three.
struct LiveScore {
  std::string name;
  double squares = 0, sigmas2 = 0, count = 0, beyond = 0;
  double bounds2 = 0, bounded = 0;  // errors in bounds, and of how many one is known
};

class LiveScores {
 public:
  explicit LiveScores(bool told) : told_(told) {}

  void Begin(const std::string& scan) { scan_ = scan; }
  // `bound`: the least error that the rays let; none where they tell of none.
  void Add(const std::string& name, double error, double sigma, double bound = NAN) {
    LiveScore& score = Of(name);
    if (bound > 0) {
      score.bounds2 += std::pow(error / bound, 2);
      score.bounded += 1;
    }
    score.squares += error * error;
    score.sigmas2 += std::pow(error / sigma, 2);
    score.count += 1;
    if (!(std::abs(error) > 3 * sigma)) return;
    score.beyond += 1;
    if (told_) {
      std::cout << scan_ << ": " << name << " is off by " << error << ", sigma " << sigma << "\n";
    }
  }
  void Count(const std::string& name, bool is_so) {
    LiveScore& score = Of(name);
    score.count += 1;
    score.beyond += is_so ? 1 : 0;
    if (is_so && told_) std::cout << scan_ << ": " << name << "\n";
  }
  void Tell(const std::string& what) const {
    if (told_) std::cout << scan_ << ": " << what << "\n";
  }
  std::vector<std::vector<std::string>> Lines() const {
    std::vector<std::vector<std::string>> lines = {{"what", "number", "rms error",
                                                    "error over sigma", "error over bound",
                                                    "beyond 3 sigma, or so"}};
    for (const LiveScore& score : scores_) {
      const bool is_value = score.sigmas2 > 0;
      lines.push_back({score.name, Number(score.count),
                       is_value ? Number(std::sqrt(score.squares / score.count)) : "-",
                       is_value ? Number(std::sqrt(score.sigmas2 / score.count)) : "-",
                       score.bounded > 0 ? Number(std::sqrt(score.bounds2 / score.bounded)) : "-",
                       Number(score.beyond)});
    }
    return lines;
  }

 private:
  LiveScore& Of(const std::string& name) {
    for (LiveScore& score : scores_) {
      if (score.name == name) return score;
    }
    return scores_.emplace_back(LiveScore{name});
  }

  bool told_;
  std::string scan_;
  std::vector<LiveScore> scores_;
};

void DrawFeatures(const hal::Tube& tube, std::mt19937_64& random, hal::TubeFeatures& features) {
  const double r_mm = tube.pipe_radius_mm, length_mm = hal::SpineLength(tube.program);
  const auto around = [&] { return Uniform(random, -180, 180); };
  features.first_end = {Uniform(random, 0, 20), around()};
  features.last_end = {Uniform(random, 0, 20), around()};
  const hal::BendRow& row = tube.program.rows.front();
  const double hole_mm = Uniform(random, 0.25, 1.2) * r_mm;
  const double bent_mm = Uniform(random, 0.25, 1.2) * r_mm;
  const double width_mm = Uniform(random, 0.3, 0.8) * r_mm;
  const double bend_mm = *row.bend_radius_mm * row.angle_deg * hal::kRadiansPerDegree;
  features.openings = {
      {Uniform(random, 2.2, 3) * r_mm, around(), hole_mm, hole_mm, 0},
      {row.length_mm + Uniform(random, 0.3, 0.7) * bend_mm, around(), bent_mm, bent_mm, 0},
      {length_mm - Uniform(random, 3, 4) * r_mm, around(), Uniform(random, 1.5, 3) * width_mm,
       width_mm, Uniform(random, 0, 1) < 0.5 ? 0 : Uniform(random, -90, 90)}};
  features.dents = {{row.length_mm - Uniform(random, 2.5, 3) * r_mm, around(),
                     Uniform(random, 0.02, 0.15) * r_mm, Uniform(random, 0.3, 0.6) * r_mm}};
}

// The least errors of the ends as the measurement has them.
struct EndBounds {
  Eigen::Vector3d first, last;
};

// `truth`: in the order of the scan's own.
void ScoreOpenings(const CutScan& scanned, const pipeline::Measurement& m,
                   const hal::TubeFeatures& truth, const EndBounds& ends, LiveScores& scores) {
  const double true_length_mm = hal::SpineLength(scanned.tube.program);
  const double longer_mm = hal::SpineLength(m.tube.program) - true_length_mm;
  const double least_width_mm = 4 * scanned.options.path.profile_spacing_mm;
  std::vector<bool> is_true(m.features.openings.size(), false);
  for (std::size_t k = 0; k < truth.openings.size(); ++k) {
    const hal::WallOpening& opening = truth.openings[k];
    const bool is_behind = 2 * opening.along_mm > true_length_mm;
    const double at_mm = opening.along_mm + (is_behind ? longer_mm : 0);
    const std::string kind = opening.is_hole() ? "hole" : "slot";
    const double seen = opening.width_mm / least_width_mm;
    const std::string size = seen < 1 ? "small " : seen < 2 ? "" : "large ";
    bool is_found = false;
    for (std::size_t i = 0; i < is_true.size(); ++i) {
      const hal::WallOpening &is = m.features.openings[i].opening,
                             &sigma = m.features.openings[i].sigma;
      const double aside_mm =
          Turn(is.around_deg, opening.around_deg) * hal::kRadiansPerDegree * m.tube.pipe_radius_mm;
      if (std::hypot(is.along_mm - at_mm, aside_mm) > 0.5 * opening.length_mm) continue;
      is_true[i] = is_found = true;
      scores.Count(kind + ": taken for another", is.is_hole() != opening.is_hole());
      if (is.is_hole() != opening.is_hole()) continue;
      const Eigen::VectorXd bound = RayBound(scanned, scanned.options.features.openings[k]);
      const auto least = [&](Eigen::Index of) { return of < bound.size() ? bound[of] : NAN; };
      const double degrees_of_mm = hal::kDegreesPerRadian / scanned.tube.pipe_radius_mm;
      // It is counted from the end.
      scores.Add(kind + ": along mm", is.along_mm - at_mm, sigma.along_mm,
                 std::hypot(least(0), is_behind ? ends.last[0] : ends.first[0]));
      scores.Add(kind + ": around deg", Turn(is.around_deg, opening.around_deg), sigma.around_deg,
                 least(1) * degrees_of_mm);
      scores.Add(kind + ": width mm", is.width_mm - opening.width_mm, sigma.width_mm, least(2));
      if (opening.is_hole()) continue;
      scores.Add("slot: length mm", is.length_mm - opening.length_mm, sigma.length_mm, least(3));
      scores.Add("slot: axis deg", std::remainder(is.axis_deg - opening.axis_deg, 180.0),
                 sigma.axis_deg, least(4) * hal::kDegreesPerRadian);
    }
    scores.Count(size + kind + ": not found", !is_found);
  }
  for (std::size_t i = 0; i < is_true.size(); ++i) {
    if (is_true[i]) continue;
    const hal::WallOpening& is = m.features.openings[i].opening;
    scores.Count("opening where none is", true);
    scores.Tell("it is " + std::to_string(is.length_mm) + " x " + std::to_string(is.width_mm) +
                " at " + std::to_string(is.along_mm) + " mm, " + std::to_string(is.around_deg) +
                " deg");
  }
}

void ScoreDents(const pipeline::Measurement& m, const hal::TubeFeatures& truth,
                double true_length_mm, LiveScores& scores) {
  const bool has_false = m.dents.size() > truth.dents.size();
  scores.Count("dents: more than are", has_false);
  for (const pipeline::DentFound& dent : m.dents) {
    if (has_false) {
      scores.Tell("one is " + std::to_string(dent.depth_mm) + " deep, at " +
                  std::to_string(dent.along_mm) + " mm, " + std::to_string(dent.around_deg) +
                  " deg");
    }
  }
  for (const hal::PressedDent& pressed : truth.dents) {
    scores.Count("dent: not found", m.dents.empty());
    if (m.dents.size() != 1) continue;
    const pipeline::DentFound& dent = m.dents.front();
    const double longer_mm = hal::SpineLength(m.tube.program) - true_length_mm;
    scores.Add(
        "dent: along mm",
        dent.along_mm - pressed.along_mm - (2 * pressed.along_mm > true_length_mm ? longer_mm : 0),
        dent.along_sigma_mm);
    scores.Add("dent: around deg", Turn(dent.around_deg, pressed.around_deg),
               dent.around_sigma_deg);
    scores.Add("dent: depth mm", dent.depth_mm - pressed.depth_mm, dent.sigma_mm);
    scores.Add("dent: area mm2",
               dent.area_mm2 -
                   2 * std::numbers::pi * std::numbers::ln2 * pressed.width_mm * pressed.width_mm,
               dent.area_sigma_mm2);
  }
}

void ScoreEnd(const pipeline::Measurement& m, bool at_start, double true_length_mm,
              const hal::EndCut& cut, const Eigen::Vector3d& bound, LiveScores& scores) {
  const auto& end = at_start ? m.features.first_end : m.features.last_end;
  const auto &rows = m.tube.program.rows, &sigmas = m.sigma.rows;
  // The bound is over cuts of all slopes, of which a square one is the least likely.
  const bool is_oblique = cut.obliquity_deg > 0;
  scores.Add(is_oblique ? "end: length mm" : "square end: length mm",
             (at_start ? rows.front() : rows.back()).length_mm - true_length_mm,
             (at_start ? sigmas.front() : sigmas.back()).length_mm, is_oblique ? bound[0] : NAN);
  scores.Count("end: not told", !end);
  if (!end) return;
  scores.Count("end: bevel, burr or border that is none",
               end->bevel || end->burr || !end->border.empty());
  // How steep a square end is found is no normal number.
  const bool is_steep = cut.obliquity_deg > 5 * end->obliquity_sigma_deg;
  scores.Add(is_steep ? "end: obliquity deg" : "square end: obliquity deg",
             end->cut.obliquity_deg - cut.obliquity_deg, end->obliquity_sigma_deg,
             is_steep ? bound[1] * hal::kDegreesPerRadian : NAN);
  if (!is_steep) return;
  const double slope = std::tan(cut.obliquity_deg * hal::kRadiansPerDegree);
  scores.Add("end: longest at deg", Turn(end->cut.around_deg, cut.around_deg),
             end->around_sigma_deg, bound[2] / slope * hal::kDegreesPerRadian);
}

void ScoreLive(const CutScan& scanned, const pipeline::Measurement& m, LiveScores& scores) {
  hal::TubeFeatures truth = scanned.options.features;
  hal::BendProgram program = scanned.tube.program;
  const double true_length_mm = hal::SpineLength(program);
  const Eigen::Vector3d& start_mm = scanned.tube.X_WT.position_mm;
  const Eigen::Vector3d end_mm = pipeline::ReverseTube(scanned.tube).X_WT.position_mm;
  const Eigen::Vector3d& first_mm = m.tube.X_WT.position_mm;
  const bool is_reversed = (first_mm - start_mm).norm() > (first_mm - end_mm).norm();
  if (is_reversed) {
    truth = tests::ReversedFeatures(truth, scanned.tube);
    program = pipeline::ReverseProgram(program);
  }
  const EndBounds ends{RayBound(scanned, !is_reversed), RayBound(scanned, is_reversed)};
  ScoreEnd(m, true, program.rows.front().length_mm, truth.first_end, ends.first, scores);
  ScoreEnd(m, false, program.rows.back().length_mm, truth.last_end, ends.last, scores);
  for (std::size_t i = 1; i + 1 < program.rows.size(); ++i) {
    scores.Add("rotation deg",
               Turn(m.tube.program.rows[i].rotation_deg, program.rows[i].rotation_deg),
               m.sigma.rows[i].rotation_deg);
  }
  ScoreOpenings(scanned, m, truth, ends, scores);
  if (m.features.openings.empty()) scores.Count("opening where none is", false);
  ScoreDents(m, truth, true_length_mm, scores);
}

}  // namespace

CutScan ALiveTube(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  CutScan scanned;
  const double r_mm = LogUniform(random, 3, 30), bend_mm = Uniform(random, 2.0, 3.5) * r_mm;
  hal::BendProgram program;
  const int bends = Uniform(random, 0, 1) < 0.5 ? 2 : 3;
  for (int i = 0; i <= bends; ++i) {
    const double length_mm = Uniform(random, 7, 12) * r_mm;
    program.rows.push_back(
        {length_mm, i > 0 ? Uniform(random, -180, 180) : 0.0, Uniform(random, 20, 110), bend_mm});
  }
  program.rows.back() = {Uniform(random, 7, 12) * r_mm, 0, 0, std::nullopt};
  scanned.tube = drivers::LayOnTable({r_mm, program, {}}, seed);
  drivers::VirtualScanOptions& options = scanned.options;
  options.seed = seed;
  options.noise_mm = LogUniform(random, 0.01, 0.1);
  options.path.profile_spacing_mm =
      LogUniform(random, std::max(0.3, 0.06 * r_mm), std::min(2.0, 0.25 * r_mm));
  const auto views = static_cast<int>(Uniform(random, 2, 9));
  options.path.views_deg = drivers::SpreadViewsDeg(views, views > 2);
  if (Uniform(random, 0, 1) < 0.75) options.path.jitter_mm = options.path.jitter_deg = 0.1;
  options.rays = static_cast<int>(Uniform(random, 120, 320));
  options.fan_half_angle_deg =
      std::atan(1.1 * r_mm / options.path.standoff_mm) * hal::kDegreesPerRadian + 1;
  if (seed % 4 != 0) DrawFeatures(scanned.tube, random, options.features);
  return scanned;
}

void PrintLive(std::uint64_t first_seed, int count, double wall_mm, bool told) {
  LiveScores scores(told);
  for (int i = 0; i < count; ++i) {
    const std::uint64_t seed = first_seed + static_cast<std::uint64_t>(i);
    CutScan scanned = ALiveTube(seed);
    scanned.options.wall_mm = std::min(wall_mm, 0.4 * scanned.tube.pipe_radius_mm);
    scores.Begin("tube " + std::to_string(seed) + " of " + Number(scanned.tube.pipe_radius_mm) +
                 " mm, lines of " + Number(scanned.options.path.profile_spacing_mm) + " mm, " +
                 std::to_string(scanned.options.path.views_deg.size()) + " passes, noise " +
                 Number(scanned.options.noise_mm) + " mm");
    const auto measurement = Measure(scanned);
    const bool is_right =
        measurement && measurement->tube.program.rows.size() == scanned.tube.program.rows.size();
    scores.Count("tube: other bends", !is_right);
    if (is_right) ScoreLive(scanned, *measurement, scores);
  }
  PrintMarkdown(std::cout, "Random tubes scanned by hand", scores.Lines(),
                {false, true, true, true, true, true});
}

}  // namespace bendloop::bench
