// SPDX-License-Identifier: Apache-2.0
// Controllers beside each other on random benders, without points: who makes how much scrap.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench_table.h"
#include "plot.h"
#include "tests/support/lot_run.h"

namespace bendloop::bench {
namespace {

using support::BenderTemper;
using support::LotBender;
using support::LotControllerKind;
using support::RunPart;

// What a controller made of the benders of one temper.
struct Score {
  double parts = 0;
  double out = 0;         // of tolerance
  double first_good = 0;  // sum over the lots
  double lots = 0;
  double squares = 0;  // of the values off the nominal, in scatters, after the run-in
  double values = 0;
  double slips = 0;            // met after the run-in
  double false_moves = 0;      // of them: the program moved by more than a scatter
  double jumps = 0, late = 0;  // and of those that were not good again with the second part after
  double forecasts = 0, promised = 0, kept = 0;  // those of 87 to 93 %
  std::vector<double> out_by_part;

  void Add(const Score& other) {
    for (double Score::*sum :
         {&Score::parts, &Score::out, &Score::first_good, &Score::lots, &Score::squares,
          &Score::values, &Score::slips, &Score::false_moves, &Score::jumps, &Score::late,
          &Score::forecasts, &Score::promised, &Score::kept}) {
      this->*sum += other.*sum;
    }
    out_by_part.resize(std::max(out_by_part.size(), other.out_by_part.size()));
    for (std::size_t i = 0; i < other.out_by_part.size(); ++i) {
      out_by_part[i] += other.out_by_part[i];
    }
  }
};

// Parts until a lot counts as settled.
constexpr std::size_t kRunIn = 20;

// Neither this tube nor the eight before it met anything.
bool IsQuiet(const std::vector<RunPart>& run, std::size_t n) {
  for (std::size_t k = n; k + 8 > n && k < run.size(); --k) {
    if (run[k].fate.slipped || run[k].fate.jumped) return false;
  }
  return true;
}

Score ScoreOf(const LotBender& bender, const std::vector<RunPart>& run) {
  Score score;
  score.lots = 1;
  score.parts = static_cast<double>(run.size());
  std::size_t first_good = run.size();
  for (std::size_t n = 0; n < run.size(); ++n) {
    const RunPart& part = run[n];
    score.out += !part.in_tolerance;
    score.out_by_part.push_back(!part.in_tolerance);
    if (part.in_tolerance) first_good = std::min(first_good, n);
    if (n >= kRunIn && IsQuiet(run, n)) {
      for (const double off : support::OffInScatters(bender, part.tube)) {
        score.squares += off * off;
        score.values += 1;
      }
    }
    if (part.fate.slipped && !part.fate.jumped && n >= kRunIn && n + 4 < run.size()) {
      score.slips += 1;
      score.false_moves += part.move > 1;
    }
    if (part.forecast && *part.forecast > 0.87 && *part.forecast < 0.93) {
      score.forecasts += 1;
      score.promised += *part.forecast;
      score.kept += part.in_tolerance;
    }
    const std::size_t again = n + 2 + bender.overlap();
    if (part.fate.jumped && n >= kRunIn && again < run.size()) {
      bool alone = true;
      for (std::size_t k = n + 1; k <= again; ++k) {
        alone = alone && !run[k].fate.slipped && !run[k].fate.jumped;
      }
      score.jumps += alone;
      score.late += alone && !run[again].in_tolerance;
    }
  }
  score.first_good = static_cast<double>(first_good + 1);
  return score;
}

using Scores = std::map<BenderTemper, std::vector<Score>>;

Scores RunAll(unsigned benders, unsigned parts, std::uint64_t seed) {
  Scores scores;
  const auto& kinds = support::LotControllers();
  for (unsigned b = 0; b < benders; ++b) {
    const BenderTemper temper = support::kBenderTempers[b % std::size(support::kBenderTempers)];
    std::vector<Score>& of_temper = scores[temper];
    of_temper.resize(kinds.size());
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      LotBender bender(seed + b, temper);
      of_temper[k].Add(ScoreOf(bender, support::RunLot(bender, kinds[k], parts)));
    }
  }
  return scores;
}

std::vector<Score> Together(const Scores& scores) {
  std::vector<Score> all(support::LotControllers().size());
  for (const auto& [temper, of_temper] : scores) {
    for (std::size_t k = 0; k < all.size(); ++k) all[k].Add(of_temper[k]);
  }
  return all;
}

std::string Ratio(double a, double b) { return b > 0 ? Number(a / b) : "-"; }

void Print(const Scores& scores) {
  std::vector<std::vector<std::string>> out = {{"out of tolerance"}};
  for (const auto& kind : support::LotControllers()) out[0].push_back(kind.name);
  const auto line = [&](const std::string& name, const std::vector<Score>& of) {
    out.push_back({name});
    for (const Score& score : of) out.back().push_back(Number(score.out));
  };
  for (const auto& [temper, of] : scores) line(std::string(Name(temper)), of);
  const std::vector<Score> all = Together(scores);
  line("all", all);
  std::vector<bool> numbers(out[0].size(), true);
  numbers[0] = false;
  PrintMarkdown(std::cout, "", out, numbers);
  std::vector<std::vector<std::string>> more = {{"over all benders"}};
  more[0].insert(more[0].end(), out[0].begin() + 1, out[0].end());
  const auto add = [&](const char* name, auto value) {
    more.push_back({name});
    for (const Score& score : all) more.back().push_back(value(score));
  };
  add("out of tolerance, over the oracle's",
      [&](const Score& s) { return Ratio(s.out, all.back().out); });
  add("first good part", [](const Score& s) { return Ratio(s.first_good, s.lots); });
  more.push_back({"rms, over the bender's scatter (steady)"});
  for (const Score& s : scores.at(BenderTemper::kSteady)) {
    more.back().push_back(Number(std::sqrt(s.squares / s.values)));
  }
  add("the same, all benders",
      [](const Score& s) { return Number(std::sqrt(s.squares / s.values)); });
  add("slips that moved the program by a scatter, %",
      [](const Score& s) { return Ratio(100 * s.false_moves, s.slips); });
  add("jumps still bad two parts later, %",
      [](const Score& s) { return Ratio(100 * s.late, s.jumps); });
  add("of forecasts of 87 to 93 %: their mean, %",
      [](const Score& s) { return Ratio(100 * s.promised, s.forecasts); });
  add("came true, %", [](const Score& s) { return Ratio(100 * s.kept, s.forecasts); });
  std::cout << "\n";
  PrintMarkdown(std::cout, "", more, numbers);
}

nlohmann::json ToJson(const Scores& scores) {
  nlohmann::json json = nlohmann::json::object();
  const auto& kinds = support::LotControllers();
  for (const auto& [temper, of] : scores) {
    for (std::size_t k = 0; k < kinds.size(); ++k) {
      const Score& s = of[k];
      json[std::string(Name(temper))][kinds[k].name] = {
          {"parts", s.parts},
          {"out_of_tolerance", s.out},
          {"first_good", s.first_good / s.lots},
          {"rms_scatters", std::sqrt(s.squares / s.values)},
          {"slips", s.slips},
          {"false_moves", s.false_moves},
          {"jumps", s.jumps},
          {"late", s.late},
          {"forecasts", s.forecasts},
          {"promised", s.promised},
          {"kept", s.kept}};
    }
  }
  return json;
}

// Tubes out of tolerance so far, over the tubes of a lot, all benders together.
std::string Drawn(const Scores& scores) {
  const std::vector<Score> all = Together(scores);
  const auto& kinds = support::LotControllers();
  double most = 0;
  for (const Score& s : all) most = std::max(most, s.out);
  Picture picture(760, 420);
  Panel panel(picture, {70, 40, 500, 320}, "Tubes out of tolerance, all benders together",
              {"part of the lot", 0, static_cast<double>(all[0].out_by_part.size())},
              LinearAxis("out of tolerance so far", most));
  std::vector<LegendEntry> legend;
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    std::vector<PlotPoint> line;
    double sum = 0;
    for (std::size_t n = 0; n < all[k].out_by_part.size(); ++n) {
      sum += all[k].out_by_part[n];
      line.push_back({static_cast<double>(n + 1), sum});
    }
    const LineStyle style = k + 1 == kinds.size() ? LineStyle::kDashed : LineStyle::kFull;
    panel.Line(line, colour::OfSeries(k), style);
    const LegendEntry entry{kinds[k].name, colour::OfSeries(k), style};
    DrawLegend(picture, 590, 60 + 24 * static_cast<double>(k), std::span(&entry, 1));
  }
  return picture.Svg();
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  using namespace bendloop::bench;
  unsigned benders = 200;
  unsigned parts = 200;
  std::uint64_t seed = 1;
  std::string json;
  std::string svg;
  CLI::App app{"Controllers beside each other on random benders."};
  app.add_option("--benders", benders)->check(CLI::Range(6, 100000));
  app.add_option("--parts", parts)->check(CLI::Range(30, 100000));
  app.add_option("--seed", seed, "of the first bender");
  app.add_option("--json", json, "write the figures here");
  app.add_option("--svg", svg, "write the picture here");
  CLI11_PARSE(app, argc, argv);
  const Scores scores = RunAll(benders, parts, seed);
  Print(scores);
  if (!json.empty()) std::ofstream(json) << ToJson(scores).dump(2) << "\n";
  if (!svg.empty()) std::ofstream(svg) << Drawn(scores);
  return 0;
}
