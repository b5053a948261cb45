// SPDX-License-Identifier: Apache-2.0
// Fits of borders beside each other: the paper's (Stamati & Fudos 2008) and all at once with Ceres,
// on borders whose form is known, and the grooves of a made handle from cloud to curve.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <string>
#include <vector>

#include "pipeline/features/border_corners.h"
#include "pipeline/features/border_fit_ceres.h"
#include "pipeline/features/feature_borders.h"
#include "tests/bench/bench_table.h"
#include "tests/bench/stopwatch.h"
#include "tests/support/border_shapes.h"
#include "tests/support/grooved_handle.h"

namespace bendloop::bench {
namespace {

using pipeline::BorderFit;
using pipeline::OrderedBorder;

// Points of each border; the paper's has 450 and 498 before thinning.
constexpr std::size_t kPoints = 300;

struct Case {
  std::string name;
  tests::BorderShape shape;
};

std::vector<Case> Cases() {
  return {{"ellipse, cut 15 deg off square", tests::ObliqueCut(12, 0.2618)},
          {"ellipse, cut 45 deg off square", tests::ObliqueCut(12, 0.7854)},
          {"hole 8 mm, radial", tests::DrilledHole(12, 4, 0, 0)},
          {"hole 8 mm, 3 mm beside, leaning", tests::DrilledHole(12, 4, 3, 0.3)},
          {"slot 20 x 6 mm, square ends", tests::SquareSlot(12, 20, 6)}};
}

std::string Power(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

// Means over the seeds.
struct Means {
  double relative = 0, error_mm = 0, sigma_mm = 0, pieces = 0, ms = 0;
};

template <class F>
Means Over(int seeds, const Case& of, double noise_mm, F fit) {
  Means means;
  for (int seed = 1; seed <= seeds; ++seed) {
    OrderedBorder border =
        tests::SampleBorder(of.shape, kPoints, noise_mm, static_cast<unsigned>(seed), 0.013);
    border.corners = pipeline::FindCorners(border, pipeline::BorderNoiseMm(border));
    const Stopwatch watch;
    const BorderFit found = fit(border);
    means.ms += watch.Read().cpu_ms / seeds;
    means.relative += found.Relative() / seeds;
    means.error_mm += tests::CurveErrorMm(found.curve, of.shape) / seeds;
    means.sigma_mm += found.curve_sigma_mm / seeds;
    means.pieces += static_cast<double>(found.curve.pieces.size()) / seeds;
  }
  return means;
}

BorderFit Paper(const OrderedBorder& border, int refinements) {
  pipeline::PaperFitOptions options;
  options.refinements = refinements;
  return FitBorderAsPaper(border, EvenBreaks(border, border.corners.empty() ? 4 : 1), options);
}

void Compare(int seeds) {
  std::vector<std::vector<std::string>> lines = {{"border", "noise mm", "paper E/m/chord2",
                                                  "off mm", "refined", "off mm", "Ceres", "off mm",
                                                  "1 sigma mm", "pieces", "ms"}};
  for (const Case& of : Cases()) {
    for (const double noise_mm : {0.01, 0.05, 0.1}) {
      const Means paper =
          Over(seeds, of, noise_mm, [](const OrderedBorder& b) { return Paper(b, 0); });
      const Means refined =
          Over(seeds, of, noise_mm, [](const OrderedBorder& b) { return Paper(b, 5); });
      const Means ceres = Over(seeds, of, noise_mm, [](const OrderedBorder& b) {
        const auto fit = pipeline::FitBorder(b);
        return fit ? *fit : BorderFit();
      });
      lines.push_back({of.name, Number(noise_mm), Power(paper.relative), Number(paper.error_mm),
                       Power(refined.relative), Number(refined.error_mm), Power(ceres.relative),
                       Number(ceres.error_mm), Number(ceres.sigma_mm), Number(ceres.pieces),
                       Number(ceres.ms)});
    }
  }
  PrintMarkdown(std::cout, "Fits of known borders", lines,
                {false, true, true, true, true, true, true, true, true, true, true});
}

void Handle() {
  std::vector<std::vector<std::string>> lines = {
      {"noise mm", "points", "grooves of 6", "borders", "worst E/m/chord2", "mean", "s"}};
  for (const double noise_mm : {0.0, 0.02, 0.05}) {
    const auto cloud = tests::GroovedHandle().Scan(40'000, noise_mm, 1);
    const Stopwatch watch;
    const auto found = pipeline::FindFeatureBorders(cloud);
    const double seconds = watch.Read().cpu_ms / 1000;
    if (!found) continue;
    int grooves = 0;
    for (const auto& region : found->regions) grooves += region.concave ? 1 : 0;
    double worst = 0, mean = 0;
    for (const auto& border : found->borders) {
      worst = std::max(worst, border.fit.Relative());
      mean += border.fit.Relative() / static_cast<double>(found->borders.size());
    }
    lines.push_back({Number(noise_mm), std::to_string(cloud.size()), std::to_string(grooves),
                     std::to_string(found->borders.size()), Power(worst), Power(mean),
                     Number(seconds)});
  }
  PrintMarkdown(std::cout, "A handle with grooves, cloud to curves", lines,
                {true, true, true, true, true, true, true});
}

}  // namespace
}  // namespace bendloop::bench

int main(int argc, char** argv) {
  CLI::App app{"Fits of borders: the paper's and Ceres's"};
  int seeds = 5;
  app.add_option("--seeds", seeds, "Borders a line")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  bendloop::bench::Compare(seeds);
  bendloop::bench::Handle();
  return 0;
}
