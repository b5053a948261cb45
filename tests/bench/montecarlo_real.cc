// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/montecarlo_real.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "hal/clock.h"
#include "hal/spine.h"
#include "pipeline/tube/representations.h"
#include "pipeline/tube_model.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/comparison.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/tube_runs.h"
#include "tests/support/synthetic_cloud.h"

namespace bendloop::bench {
namespace {

using Random = std::mt19937_64;
using Range = std::array<double, 2>;

constexpr const char* kAnything = "anything";

// What all tubes of a kind share; the rest is drawn from the ranges.
struct RealKind {
  const char* name;
  Range straight_r = {4, 14};
  Range bow = {0, 0};  // of each straight: height over length
  Range easing_r = {0, 0};
  int dents = 0;
  Range dent_depth_r = {0.02, 0.2};
  std::optional<Range> dents_in_bends_r = {};  // as wide; else anywhere
  Range thinning = {1, 1};
  Range drift_mm = {0, 0};
  Range heavy_tail = {0, 0};
  Range ovality = {0, 0}, sunk = {0, 0};
  std::optional<Range> section_rise_r = {};
  tests::EndFitting at_end = tests::EndFitting::kNone;
  int slight_bends = 0;  // of 1.5 to 4 degrees
  Range noise_mm = {0.05, 0.05};
  Range points = {24e3, 24e3};  // evenly in their logarithm
  Range wrinkles = {0, 0}, seam = {0, 0};
  bool thins_all_along = false;
  bool on_table = false;
};

// Of anything: how often a tube has each of what makes it real.
constexpr double kOften = 0.4;

const std::vector<RealKind>& Kinds() {
  using enum tests::EndFitting;
  static const std::vector<RealKind> kinds = {
      {.name = "plain"},
      {.name = "bow L/2000", .bow = {0.0005, 0.0005}},
      {.name = "bow L/1000", .bow = {0.001, 0.001}},
      {.name = "bow L/500", .bow = {0.002, 0.002}},
      {.name = "bow L/300", .bow = {0.0033, 0.0033}},
      {.name = "long, L/1000",
       .straight_r = {25, 40},
       .bow = {0.001, 0.001},
       .points = {48e3, 48e3}},
      {.name = "long, L/500",
       .straight_r = {25, 40},
       .bow = {0.002, 0.002},
       .points = {48e3, 48e3}},
      {.name = "eased 0.4 r", .easing_r = {0.4, 0.4}},
      {.name = "eased 0.7 r", .easing_r = {0.7, 0.7}},
      {.name = "eased 1.0 r", .easing_r = {1.0, 1.0}},
      {.name = "eased 1.5 r", .easing_r = {1.5, 1.5}},
      {.name = "one dent", .dents = 1},
      {.name = "three dents", .dents = 3},
      {.name = "thin end", .thinning = {10, 100}},
      {.name = "drift 0.1", .drift_mm = {0.1, 0.1}},
      {.name = "drift 0.2", .drift_mm = {0.2, 0.2}},
      {.name = "nut", .at_end = kNut},
      {.name = "flange", .at_end = kFlange},
      {.name = "flare", .at_end = kFlare},
      {.name = "cap", .at_end = kCap},
      {.name = "heavy tails", .heavy_tail = {0.3, 1.0}},
      {.name = "oval 8 %", .easing_r = {0.2, 0.5}, .ovality = {0.08, 0.08}},
      {.name = "compact", .straight_r = {1, 2.5}},
      {.name = "compact, oval 5 %", .straight_r = {1, 2.5}, .ovality = {0.05, 0.05}},
      {.name = "compact, drift", .straight_r = {1, 2.5}, .drift_mm = {0.1, 0.1}},
      {.name = "slight bends", .straight_r = {8, 14}, .slight_bends = 2},
      {.name = "slight, bowed", .straight_r = {8, 14}, .bow = {0.0003, 0.001}, .slight_bends = 2},
      {.name = "mixed",
       .bow = {0.0003, 0.002},
       .easing_r = {0.1, 1.0},
       .dents = 1,
       .drift_mm = {0, 0.1},
       .ovality = {0, 0.05}},
      {.name = "mixed, fine",
       .bow = {0.0003, 0.002},
       .easing_r = {0.1, 1.0},
       .dents = 1,
       .ovality = {0, 0.05},
       .noise_mm = {0.005, 0.02},
       .points = {50e3, 150e3}},
      {.name = "few points", .points = {1e3, 4e3}},
      {.name = "many points", .bow = {0, 0.001}, .easing_r = {0, 0.7}, .points = {500e3, 4e6}},
      {.name = "noise 0.005", .bow = {0, 0.001}, .easing_r = {0, 0.7}, .noise_mm = {0.005, 0.005}},
      {.name = "noise 0.3", .noise_mm = {0.3, 0.3}},
      {.name = "heavy tails 0.2", .heavy_tail = {0.3, 1.0}, .noise_mm = {0.2, 0.2}},
      {.name = "oval, wrinkles",
       .easing_r = {0.2, 0.5},
       .ovality = {0.08, 0.08},
       .wrinkles = {0.005, 0.02}},
      {.name = "seam", .seam = {0.02, 0.06}},
      {.name = "thinning", .thinning = {10, 100}, .thins_all_along = true},
      {.name = kAnything},
      {.name = "on a table", .bow = {0, 0.001}, .easing_r = {0, 0.7}, .on_table = true},
      {.name = "thin end, on a table", .thinning = {10, 100}, .on_table = true},
      {.name = "dented bends",
       .dents = 2,
       .dent_depth_r = {0.03, 0.15},
       .dents_in_bends_r = Range{0.5, 1.2},
       .noise_mm = {0.01, 0.05}},
      {.name = "oval before bends",
       .ovality = {0.01, 0.05},
       .sunk = {0, 0.02},
       .section_rise_r = Range{0.3, 0.8},
       .noise_mm = {0.01, 0.05}},
  };
  return kinds;
}

double Uniform(Random& random, double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(random);
}
double Uniform(Random& random, const Range& range) { return Uniform(random, range[0], range[1]); }

enum class Outcome { kRight, kTold, kRefused, kSilent };
constexpr std::array<const char*, 4> kOutcomes = {"right", "told", "refused", "silently wrong"};
constexpr double kFarOff = 6;  // sigma

struct RealResult {
  std::uint64_t seed = 0;
  std::string kind;
  Outcome outcome = Outcome::kSilent;
  bool warned = false;  // of what is right
  bool far_off = false;
  std::string note;
  LraRatios over_sigma;
  Ratio ends_over_sigma;
  double ms = 0;
};

std::string Describe(const hal::BendProgram& program) {
  std::string text;
  for (const hal::BendRow& row : program.rows) {
    text += (text.empty() ? "" : " | ") + Number(row.length_mm);
    if (row.bend_radius_mm && row.angle_deg > 0) {
      text += " " + Number(row.rotation_deg) + " " + Number(row.angle_deg) + " r" +
              Number(*row.bend_radius_mm);
    }
  }
  return text;
}

double LogUniform(Random& random, const Range& range) {
  return std::exp(Uniform(random, std::log(range[0]), std::log(range[1])));
}

// A tube of any size with some of all that tubes and scans have, beside what the kind says.
struct AnySize {
  double r_mm = 5;
  int bends = 5;
  int views = 4;
};
AnySize DrawAnything(Random& random, RealKind& kind) {
  const auto sometimes = [&](Range range) {
    const double value = Uniform(random, range);
    return Uniform(random, 0, 1) < kOften ? Range{value, value} : Range{0, 0};
  };
  AnySize size;
  size.r_mm = LogUniform(random, {2, 25});
  size.bends = static_cast<int>(Uniform(random, 1, 10));
  size.views = static_cast<int>(Uniform(random, 2, 6));
  const double noise_mm = std::clamp(size.r_mm * LogUniform(random, {0.001, 0.03}), 0.005, 0.3);
  kind.noise_mm = {noise_mm, noise_mm};
  kind.points = {10e3, 300e3};
  kind.straight_r = {3, 15};
  kind.bow = sometimes({0.0002, 0.0033});
  kind.easing_r = sometimes({0.1, 1.2});
  kind.dents = Uniform(random, 0, 1) < kOften ? 1 + static_cast<int>(Uniform(random, 0, 3)) : 0;
  kind.ovality = sometimes({0.01, 0.08});
  kind.wrinkles = sometimes({0.002, 0.015});
  kind.seam = sometimes({0.01, 0.05});
  kind.heavy_tail = sometimes({0.1, 1});
  if (Uniform(random, 0, 1) < kOften) kind.thinning = {3, 50};
  kind.thins_all_along = Uniform(random, 0, 1) < 0.5;
  using enum tests::EndFitting;
  constexpr std::array<tests::EndFitting, 5> kFittings = {kNone, kNut, kFlange, kFlare, kBead};
  if (Uniform(random, 0, 1) < kOften) {
    kind.at_end = kFittings[static_cast<std::size_t>(Uniform(random, 0, 5))];
  }
  return size;
}

// Anywhere, or in a bend.
tests::Dent DrawDent(const hal::BendProgram& program, const RealKind& kind, Random& random) {
  tests::Dent dent{.along = Uniform(random, 0.05, 0.95),
                   .around_rad = Uniform(random, -3, 3),
                   .depth_r = Uniform(random, kind.dent_depth_r)};
  if (!kind.dents_in_bends_r) return dent;
  dent.width_r = Uniform(random, *kind.dents_in_bends_r);
  const std::vector<hal::SpineSegment> segments = hal::SpineSegments(program, hal::Pose{});
  const auto bend =
      static_cast<std::size_t>(Uniform(random, 0, static_cast<double>(program.bend_count())));
  const hal::SpineSegment& arc = segments[2 * bend + 1];
  dent.along =
      (arc.from_start_mm + Uniform(random, 0, 1) * arc.length_mm) / hal::SpineLength(program);
  return dent;
}

// Errors over sigma, one way round.
RealResult Errors(const hal::Tube& truth, const pipeline::Measurement& measured,
                  const hal::BendProgram& found, const hal::BendProgram& sigma) {
  RealResult result;
  double worst = 0;
  const auto add = [&](Ratio& ratio, const char* what, std::size_t row, double error, double one) {
    if (!(one > 0)) return;
    ratio.Add(error / one);
    if (std::abs(error / one) <= std::max(kFarOff, worst)) return;
    worst = std::abs(error / one);
    result.far_off = true;
    result.note = std::string(what) + std::to_string(row + 1) + " off by " + Number(error) + ", " +
                  Number(worst) + " sigma";
  };
  for (std::size_t i = 0; i < found.rows.size(); ++i) {
    const hal::BendRow &is = found.rows[i], &was = truth.program.rows[i], &one = sigma.rows[i];
    const bool end = i == 0 || i + 1 == found.rows.size();
    add(end ? result.ends_over_sigma : result.over_sigma.length, "L", i,
        is.length_mm - was.length_mm, one.length_mm);
    if (i + 1 == found.rows.size()) break;
    add(result.over_sigma.angle, "A", i, is.angle_deg - was.angle_deg, one.angle_deg);
    add(result.over_sigma.bend_radius, "CLR", i, *is.bend_radius_mm - *was.bend_radius_mm,
        one.bend_radius_mm.value_or(0));
    if (i == 0) continue;
    add(result.over_sigma.rotation, "R", i,
        hal::WrapRotationDeg(is.rotation_deg - was.rotation_deg), one.rotation_deg);
  }
  add(result.over_sigma.pipe_radius, "r", 0, measured.tube.pipe_radius_mm - truth.pipe_radius_mm,
      measured.pipe_radius_sigma_mm);
  return result;
}

// One way round or the other: of one bend only the ends tell.
double Misfit(const RealResult& result, std::size_t bends) {
  if (bends == 1) return result.ends_over_sigma.sum2;
  return result.over_sigma.length.sum2 + result.over_sigma.rotation.sum2 +
         result.over_sigma.angle.sum2;
}

std::string DescribeDents(const RealCase& scan) {
  const double length_mm = hal::SpineLength(scan.cloud.truth.program);
  std::string dents;
  for (const tests::Dent& dent : scan.form.dents) {
    dents += " at " + Number(dent.along * length_mm) + " mm, " + Number(dent.around_rad) +
             " rad, " + Number(dent.depth_r * scan.cloud.truth.pipe_radius_mm) + " deep;";
  }
  return dents;
}

RealResult Measure(std::uint64_t seed, const RealRun& run) {
  const RealCase scan = DrawRealCase(seed, run.kind.empty() ? RealKindOf(seed) : run.kind);
  pipeline::ReconstructionOptions options;
  if (run.with_nominal) options.nominal = scan.nominal;
  const hal::SteadyClock clock;
  const Stopwatch watch;
  const auto measured =
      pipeline::ReconstructModel(scan.cloud.points_W, pipeline::TubeModel::kAuto, options, clock);
  const double ms = watch.Read().wall_ms;
  RealResult result;
  const hal::Tube& truth = scan.cloud.truth;
  if (!measured) {
    result.outcome = Outcome::kRefused;
    result.note = measured.error().message;
  } else if (measured->tube.program.bend_count() != truth.program.bend_count()) {
    result.outcome = measured->warnings.empty() ? Outcome::kSilent : Outcome::kTold;
    result.note = "found " + std::to_string(measured->tube.program.bend_count()) + " of " +
                  std::to_string(truth.program.bend_count()) + " bends, margin " +
                  Number(measured->structure_margin);
  } else {
    const auto& found = measured->tube.program;
    result = Errors(truth, *measured, found, measured->sigma);
    RealResult reverse = Errors(truth, *measured, pipeline::ReverseProgram(found),
                                pipeline::ReverseProgram(measured->sigma));
    const std::size_t bends = found.bend_count();
    if (Misfit(reverse, bends) < Misfit(result, bends)) result = std::move(reverse);
    result.outcome = Outcome::kRight;
    result.warned = !measured->warnings.empty();
  }
  if (run.verbose) {
    std::cout << seed << ' ' << scan.kind << ", " << scan.cloud.points_W.size() << " points, "
              << Number(ms) << " ms\ntrue  " << Describe(truth.program) << "\neased by "
              << scan.form.easing_r << " r, oval " << scan.form.ovality << ", dents"
              << DescribeDents(scan) << '\n';
    if (measured) {
      std::cout << "found " << Describe(measured->tube.program) << "\nsigma "
                << Describe(measured->sigma) << "\npipe radius " << measured->tube.pipe_radius_mm
                << " +- " << measured->pipe_radius_sigma_mm << ", noise " << measured->noise_mm
                << ", margin " << measured->structure_margin << "\ndents";
      for (const auto& dent : measured->dents) {
        std::cout << " at " << dent.along_mm << " mm " << dent.depth_mm << " deep;";
      }
      std::cout << "\neased over";
      for (const auto& easing : measured->bend_easings) std::cout << ' ' << easing.length_mm;
      std::cout << ", bowed by";
      for (const auto& straight : measured->straights) std::cout << ' ' << straight.height_mm;
      std::cout << '\n';
      for (const std::string& warning : measured->warnings) std::cout << "- " << warning << '\n';
    }
  }
  result.seed = seed;
  result.kind = scan.kind;
  result.ms = ms;
  return result;
}

// Of one kind, or of all.
struct Summary {
  std::array<int, 4> outcomes{};
  int far_off = 0, warned = 0;
  LraRatios over_sigma;
  Ratio ends;
  double ms = 0;

  int Tubes() const { return outcomes[0] + outcomes[1] + outcomes[2] + outcomes[3]; }
  void Add(const RealResult& tube) {
    ++outcomes[static_cast<std::size_t>(tube.outcome)];
    ms += tube.ms;
    far_off += tube.far_off ? 1 : 0;
    warned += tube.warned ? 1 : 0;
    over_sigma.Add(tube.over_sigma);
    ends.Add(tube.ends_over_sigma);
  }
  std::vector<std::string> Line(const std::string& name) const {
    const auto share = [](int count) { return std::to_string(count); };
    return {name,
            std::to_string(Tubes()),
            share(outcomes[0]),
            share(outcomes[1]),
            share(outcomes[2]),
            share(outcomes[3]),
            share(warned),
            share(far_off),
            Number(over_sigma.length.Rms()),
            Number(over_sigma.rotation.Rms()),
            Number(over_sigma.angle.Rms()),
            Number(over_sigma.bend_radius.Rms()),
            Number(over_sigma.pipe_radius.Rms()),
            Number(ends.Rms()),
            Number(ms / std::max(1, Tubes()))};
  }
};

}  // namespace

const std::vector<std::string>& RealKinds() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> list;
    for (const RealKind& kind : Kinds()) list.emplace_back(kind.name);
    return list;
  }();
  return names;
}

const std::string& RealKindOf(std::uint64_t seed) { return RealKinds()[seed % RealKinds().size()]; }

RealCase DrawRealCase(std::uint64_t seed, const std::string& kind_name) {
  RealKind kind = *std::find_if(Kinds().begin(), Kinds().end(), [&](const RealKind& candidate) {
    return candidate.name == kind_name;
  });
  Random random(seed);
  RealCase result;
  result.kind = kind.name;
  result.seed = seed;
  const AnySize size = kind.name == std::string(kAnything) ? DrawAnything(random, kind) : AnySize{};
  hal::Tube tube = tests::RandomTube({.pipe_radius_mm = size.r_mm,
                                      .bends = size.bends,
                                      .min_bend_radius = 2,
                                      .max_bend_radius = 4,
                                      .min_straight = kind.straight_r[0],
                                      .max_straight = kind.straight_r[1],
                                      .min_angle_deg = 15,
                                      .max_angle_deg = 100},
                                     random);
  for (int i = 0; i < kind.slight_bends; ++i) {
    tube.program.rows[static_cast<std::size_t>(1 + 2 * i)].angle_deg = Uniform(random, 1.5, 4);
  }
  tests::Form form;
  form.bow = Uniform(random, kind.bow);
  form.s_bow = Uniform(random, 0, 0.3) * form.bow;
  form.easing_r = Uniform(random, kind.easing_r);
  form.ramps = Uniform(random, 0, 1) < 0.3;
  form.half_sine = Uniform(random, 0, 1) < 0.5;
  form.ovality = Uniform(random, kind.ovality);
  if (kind.section_rise_r) {
    form.section_rise_r = Uniform(random, *kind.section_rise_r);
    form.sunk = Uniform(random, kind.sunk);
  }
  form.wrinkles = Uniform(random, kind.wrinkles);
  form.seam = Uniform(random, kind.seam);
  form.at_end = kind.at_end;
  for (int i = 0; i < kind.dents; ++i) {
    form.dents.push_back(DrawDent(tube.program, kind, random));
  }
  tests::RealScan scan;
  scan.points = static_cast<std::size_t>(std::llround(LogUniform(random, kind.points)));
  scan.views = size.views;
  scan.noise_mm = Uniform(random, kind.noise_mm);
  scan.heavy_tail = Uniform(random, kind.heavy_tail);
  scan.drift_mm = Uniform(random, kind.drift_mm);
  scan.drift_deg = 0.2 * scan.drift_mm;
  scan.thinning = LogUniform(random, kind.thinning);
  scan.thins_all_along = kind.thins_all_along;
  scan.on_table = kind.on_table;
  result.cloud = tests::ScanRealTube(tube, form, scan, random);
  result.form = form;
  result.nominal = result.cloud.truth.program;
  for (std::size_t i = 0; i < result.nominal.rows.size(); ++i) {
    hal::BendRow& row = result.nominal.rows[i];
    row.length_mm = std::max(0.0, row.length_mm + Uniform(random, -0.5, 0.5));
    if (i + 1 == result.nominal.rows.size()) break;
    row.angle_deg += Uniform(random, -0.5, 0.5);
    if (i > 0) row.rotation_deg = hal::WrapRotationDeg(row.rotation_deg + Uniform(random, -1, 1));
  }
  return result;
}

int RunReal(const RealRun& run) {
  const std::vector<RealResult> results = RunSeeds<RealResult>(
      run.seeds, run.threads, [&run](std::uint64_t seed) { return Measure(seed, run); });
  Summary all;
  std::map<std::string, Summary> of_kind;
  nlohmann::json json = nlohmann::json::array();
  for (const RealResult& tube : results) {
    of_kind[tube.kind].Add(tube);
    all.Add(tube);
    json.push_back({{"seed", tube.seed},
                    {"kind", tube.kind},
                    {"outcome", kOutcomes[static_cast<std::size_t>(tube.outcome)]},
                    {"note", tube.note},
                    {"ms", tube.ms}});
  }
  std::vector<std::vector<std::string>> lines = {
      {"kind", "tubes", "right", "told", "refused", "silently wrong", "right, warned", "beyond 6 s",
       "L/s", "R/s", "A/s", "CLR/s", "r/s", "ends/s", "ms"}};
  for (const std::string& kind : RealKinds()) {
    if (of_kind.contains(kind)) lines.push_back(of_kind[kind].Line(kind));
  }
  lines.push_back(all.Line("all"));
  std::vector<bool> is_number(lines[0].size(), true);
  is_number[0] = false;
  PrintMarkdown(std::cout,
                std::to_string(all.Tubes()) + " real tubes, " +
                    (run.with_nominal ? "with" : "without") + " nominal",
                lines, is_number);
  for (const RealResult& tube : results) {
    if (tube.note.empty()) continue;
    std::cout << "- " << tube.seed << ' ' << tube.kind << ", "
              << kOutcomes[static_cast<std::size_t>(tube.outcome)] << ": " << tube.note << '\n';
  }
  if (run.json_path.empty()) return 0;
  std::ofstream file(run.json_path);
  file << json.dump(2) << '\n';
  if (file.flush()) return 0;
  std::cerr << "bendloop_montecarlo: cannot write " << run.json_path << '\n';
  return 1;
}

}  // namespace bendloop::bench
