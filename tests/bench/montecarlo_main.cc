// SPDX-License-Identifier: Apache-2.0
// Random tubes: how often the number of bends is right, and how the errors compare with the
// Cramer-Rao bound and with the sigma that the measurement reports.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/reconstruction.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/comparison.h"
#include "tests/bench/montecarlo_cases.h"
#include "tests/bench/montecarlo_real.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/tube_runs.h"

namespace bendloop::bench {
namespace {

struct Options {
  TubeRuns runs{.tubes = 1000};
  std::string kind;
  std::string real;  // real tubes instead of ideal ones: with "part" or with "no" nominal
  Drawing drawing = Drawing::kOfKind;
  std::optional<std::uint64_t> only;
  std::string json_path;
};

constexpr double kFarOff = 6;  // times the bound: worth looking at, though the bends are right

const std::map<std::string, Drawing> kDrawings = {{"kind", Drawing::kOfKind},
                                                  {"part", Drawing::kPart},
                                                  {"more", Drawing::kBendMore},
                                                  {"fewer", Drawing::kBendFewer}};

enum class Outcome { kRight, kHidden, kRefused, kWrong };
constexpr std::array<const char*, 4> kOutcomes = {"right", "hidden", "refused", "wrong"};

struct TubeResult {
  std::uint64_t seed = 0;
  std::string kind;
  Outcome outcome = Outcome::kWrong;
  std::string note;  // of what is worth a line: refused, wrong, far off
  std::size_t bends = 0;
  double ms = 0;
  Comparison comparison;
};

// By how much the true structure, fitted to the points, explains them better than the one that was
// found, in twice the logarithm of the likelihood. Points that err together tell less; the bends of
// oval tubes may be oval in both.
double GainOfTruth(const MonteCarloCase& scan, const hal::Tube& found) {
  const auto points = pipeline::Thinned(
      Blocks(scan), pipeline::StrideTo(scan.points_W.size(), pipeline::kPointsAtOnce));
  const auto fit = [&](const hal::Tube& start) {
    return pipeline::FitSurface(
        start, points,
        {.reach_mm = 8 * scan.noise_mm + scan.systematic_mm, .flattened = scan.ovality > 0});
  };
  const auto misfit = [&](const pipeline::SurfaceFit& of) {
    double sum = 25.0 * static_cast<double>(of.points - of.distances_mm.size());
    for (const double d : of.distances_mm) sum += std::min(25.0, std::pow(d / scan.noise_mm, 2));
    return sum;
  };
  const pipeline::SurfaceFit truth = fit(scan.truth);
  return (misfit(fit(found)) - misfit(truth)) / truth.design_effect;
}

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

TubeResult RunTube(std::uint64_t seed, Drawing drawing, bool verbose) {
  const MonteCarloCase scan = DrawMonteCarloCase(seed, drawing);
  TubeResult result;
  result.seed = seed;
  result.kind = scan.name;
  result.bends = scan.truth.program.bend_count();
  pipeline::ReconstructionOptions options;
  options.nominal = scan.nominal;
  const hal::SteadyClock clock;
  const Stopwatch watch;
  const auto measured = pipeline::Reconstruct(scan.points_W, options, clock);
  result.ms = watch.Read().wall_ms;
  if (verbose) {
    std::cout << scan.name << ", pipe radius " << Number(scan.truth.pipe_radius_mm) << ", noise "
              << Number(scan.noise_mm) << ", " << scan.points_W.size() << " points, spacing "
              << Number(scan.spacing_mm) << "\ntrue  " << Describe(scan.truth.program) << '\n';
    if (scan.nominal) std::cout << "drawn " << Describe(*scan.nominal) << '\n';
    if (measured) {
      std::cout << "found " << Describe(measured->tube.program) << "\nsigma ";
      for (const hal::BendRow& row : measured->sigma.rows) {
        std::cout << Number(row.length_mm) << ' ' << Number(row.rotation_deg) << ' '
                  << Number(row.angle_deg) << " r" << Number(row.bend_radius_mm.value_or(0))
                  << " | ";
      }
      std::cout << "\npipe radius " << measured->tube.pipe_radius_mm << " +- "
                << measured->pipe_radius_sigma_mm << ", noise " << measured->noise_mm << '\n';
      for (const std::string& warning : measured->warnings) std::cout << "- " << warning << '\n';
    }
  }
  if (!measured) {
    result.outcome = Outcome::kRefused;
    result.note = measured.error().message;
    return result;
  }
  const std::size_t found = measured->tube.program.bend_count();
  if (found != result.bends) {
    const double gain = GainOfTruth(scan, measured->tube);
    const double price = 4.0 * std::log(static_cast<double>(scan.points_W.size()));
    const bool hidden =
        found < result.bends && gain < price * static_cast<double>(result.bends - found);
    result.outcome = hidden ? Outcome::kHidden : Outcome::kWrong;
    result.note = "found " + std::to_string(found) + " of " + std::to_string(result.bends) +
                  " bends; the true ones gain " + Number(gain);
    return result;
  }
  result.outcome = Outcome::kRight;
  const Bound bound = CramerRaoBound(scan.truth, scan.points_W, scan.noise_mm, scan.systematic_mm);
  result.comparison = Compare(scan.truth, *measured, bound, scan.spacing_mm);
  if (verbose) {
    std::cout << "bound ";
    for (const hal::BendRow& row : bound.program.rows) {
      std::cout << Number(row.length_mm) << ' ' << Number(row.rotation_deg) << ' '
                << Number(row.angle_deg) << " r" << Number(row.bend_radius_mm.value_or(0)) << " | ";
    }
    std::cout << '\n';
  }
  const double ends = result.comparison.ends_over_spacing.Rms();
  if (result.comparison.worst_over_bound > kFarOff) {
    result.note = "an error is " + Number(result.comparison.worst_over_bound) + " times the bound";
  }
  if (result.comparison.worst_over_sigma > kFarOff) {
    result.note += std::string(result.note.empty() ? "" : "; ") + "the error of " +
                   result.comparison.worst_of_sigma + " is " +
                   Number(result.comparison.worst_over_sigma) + " of its sigmas";
  }
  if (ends > 1.5) {
    result.note +=
        std::string(result.note.empty() ? "" : "; ") + "ends off by " + Number(ends) + " spacings";
  }
  return result;
}

// Of one kind, or of all.
struct Summary {
  std::array<int, 4> outcomes{};
  LraRatios over_bound, over_sigma;
  Ratio ends_over_spacing, ends_over_sigma, vague;
  double ms = 0;

  void Add(const TubeResult& tube) {
    ++outcomes[static_cast<std::size_t>(tube.outcome)];
    ms += tube.ms;
    if (tube.outcome != Outcome::kRight) return;
    over_bound.Add(tube.comparison.over_bound);
    over_sigma.Add(tube.comparison.over_sigma);
    ends_over_spacing.Add(tube.comparison.ends_over_spacing);
    ends_over_sigma.Add(tube.comparison.ends_over_sigma);
    vague.Add(tube.comparison.vague);
  }
  int Tubes() const { return outcomes[0] + outcomes[1] + outcomes[2] + outcomes[3]; }
};

struct Column {
  const char* name;
  double (*value)(const Summary&);
};

constexpr std::array<Column, 18> kColumns = {{
    {"tubes", [](const Summary& s) { return static_cast<double>(s.Tubes()); }},
    {"right", [](const Summary& s) { return static_cast<double>(s.outcomes[0]); }},
    {"hidden", [](const Summary& s) { return static_cast<double>(s.outcomes[1]); }},
    {"refused", [](const Summary& s) { return static_cast<double>(s.outcomes[2]); }},
    {"wrong", [](const Summary& s) { return static_cast<double>(s.outcomes[3]); }},
    {"L/b", [](const Summary& s) { return s.over_bound.length.Rms(); }},
    {"R/b", [](const Summary& s) { return s.over_bound.rotation.Rms(); }},
    {"A/b", [](const Summary& s) { return s.over_bound.angle.Rms(); }},
    {"CLR/b", [](const Summary& s) { return s.over_bound.bend_radius.Rms(); }},
    {"r/b", [](const Summary& s) { return s.over_bound.pipe_radius.Rms(); }},
    {"L/s", [](const Summary& s) { return s.over_sigma.length.Rms(); }},
    {"R/s", [](const Summary& s) { return s.over_sigma.rotation.Rms(); }},
    {"A/s", [](const Summary& s) { return s.over_sigma.angle.Rms(); }},
    {"CLR/s", [](const Summary& s) { return s.over_sigma.bend_radius.Rms(); }},
    {"r/s", [](const Summary& s) { return s.over_sigma.pipe_radius.Rms(); }},
    {"ends/d", [](const Summary& s) { return s.ends_over_spacing.Rms(); }},
    {"ends/s", [](const Summary& s) { return s.ends_over_sigma.Rms(); }},
    {"ms", [](const Summary& s) { return s.ms / std::max(1, s.Tubes()); }},
}};

int RunRealTubes(const Options& options) {
  const auto& kinds = RealKinds();
  RealRun run{.seeds = {},
              .kind = options.kind,
              .threads = options.runs.threads,
              .with_nominal = options.real == "part",
              .verbose = options.only.has_value(),
              .json_path = options.json_path};
  if (!options.kind.empty() && std::find(kinds.begin(), kinds.end(), options.kind) == kinds.end()) {
    std::cerr << "bendloop_montecarlo: " << options.kind << " is no kind of real tubes\n";
    return 2;
  }
  if (options.only) {
    run.seeds = {*options.only};
    return RunReal(run);
  }
  for (std::uint64_t i = 0; i < options.runs.tubes; ++i) {
    run.seeds.push_back(options.runs.first_seed() + i);
  }
  return RunReal(run);
}

int Run(const Options& options) {
  if (!options.real.empty()) return RunRealTubes(options);
  if (options.only) {
    const TubeResult tube = RunTube(*options.only, options.drawing, true);
    std::cout << kOutcomes[static_cast<std::size_t>(tube.outcome)] << ' ' << tube.note << '\n';
    return 0;
  }
  const auto& kinds = MonteCarloKinds();
  std::vector<std::uint64_t> seeds;
  for (std::uint64_t seed = options.runs.first_seed(); seeds.size() < options.runs.tubes; ++seed) {
    if (options.kind.empty() || kinds[seed % kinds.size()] == options.kind) seeds.push_back(seed);
  }
  const std::vector<TubeResult> results = RunSeeds<TubeResult>(
      seeds, options.runs.threads,
      [&options](std::uint64_t seed) { return RunTube(seed, options.drawing, false); });

  Summary all;
  std::map<std::string, Summary> of_kind;
  nlohmann::json json = {{"seed", options.runs.seed}, {"tubes", nlohmann::json::array()}};
  for (const TubeResult& tube : results) {
    of_kind[tube.kind].Add(tube);
    all.Add(tube);
    json["tubes"].push_back({{"seed", tube.seed},
                             {"kind", tube.kind},
                             {"bends", tube.bends},
                             {"outcome", kOutcomes[static_cast<std::size_t>(tube.outcome)]},
                             {"note", tube.note},
                             {"ms", tube.ms}});
  }
  std::vector<std::vector<std::string>> lines = {{"kind"}};
  for (const Column& column : kColumns) lines[0].emplace_back(column.name);
  const auto add = [&](const std::string& name, const Summary& summary) {
    auto& line = lines.emplace_back(1, name);
    for (const Column& column : kColumns) {
      const double value = column.value(summary);
      line.push_back(Number(value));
      json["kinds"][name][column.name] = value;
    }
  };
  for (const std::string& kind : kinds) {
    if (of_kind.contains(kind)) add(kind, of_kind[kind]);
  }
  add("all", all);
  std::vector<bool> is_number(lines[0].size(), true);
  is_number[0] = false;
  PrintMarkdown(std::cout, std::to_string(all.Tubes()) + " random tubes", lines, is_number);
  std::cout
      << "rms error over the Cramer-Rao bound (/b), over the reported sigma (/s), of the ends "
         "over the sample spacing (/d)\n\n";
  for (const TubeResult& tube : results) {
    if (tube.note.empty()) continue;
    std::cout << "- " << tube.seed << ' ' << tube.kind << ", "
              << kOutcomes[static_cast<std::size_t>(tube.outcome)] << ": " << tube.note << '\n';
  }
  if (options.json_path.empty()) return 0;
  std::ofstream file(options.json_path);
  file << json.dump(2) << '\n';
  if (file.flush()) return 0;
  std::cerr << "bendloop_montecarlo: cannot write " << options.json_path << '\n';
  return 1;
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  bendloop::bench::Options options;
  CLI::App app{"Random tubes: right number of bends, errors over bound and sigma, as Markdown."};
  app.footer(
      "Examples:\n"
      "  bendloop_montecarlo --tubes 200\n"
      "  bendloop_montecarlo --kind stripes --tubes 50 --json stripes.json\n"
      "  bendloop_montecarlo --real no --tubes 280\n"
      "  bendloop_montecarlo --drawing fewer    parts with a bend that their drawing does not "
      "show\n"
      "  bendloop_montecarlo --only 1000117     one tube in detail");
  options.runs.AddOptions(app);
  std::vector<std::string> kinds = bendloop::bench::MonteCarloKinds();
  const auto& real_kinds = bendloop::bench::RealKinds();
  kinds.insert(kinds.end(), real_kinds.begin(), real_kinds.end());
  app.add_option("--kind", options.kind, "Only this kind")->check(CLI::IsMember(kinds));
  app.add_option("--real", options.real,
                 "Tubes as benders make them: bowed, eased, dented, scanned with drift; with the "
                 "nominal or without")
      ->check(CLI::IsMember({"part", "no"}));
  using bendloop::bench::kDrawings;
  app.add_option("--drawing", options.drawing,
                 "The nominal: that of the part for every tube, or with a bend more or fewer than "
                 "the part, which must not hide that")
      ->transform(CLI::CheckedTransformer(kDrawings))
      ->option_text("{kind,part,more,fewer}=kind");
  app.add_option(
      "--only", options.only,
      "Only this tube, with what was found and what is true; a real one of --kind, or the seed's");
  app.add_option("--json", options.json_path, "Write every tube and figure to this file as well");
  CLI11_PARSE(app, argc, argv);
  return bendloop::bench::Run(options);
}
