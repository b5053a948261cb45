// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/unseen_wall.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "pipeline/features/views_from_afar.h"
#include "pipeline/features/wall_patches.h"

namespace bendloop::pipeline {
namespace {

struct UnseenSettings {
  double fliers = 1e-3;  // part of the samples that no view explains
  // Of expectation maximisation: the odds are within one of what ten times as many tell.
  int rounds = 60;
};
constexpr UnseenSettings kUnseen;

enum class Inside { kNoWall, kWall };

// [log] How likely the samples are, a Poisson process, with as many of each of the views as they
// say themselves.
double LogOfViews(std::span<const WallPatch> patches, std::span<const PatchesSeen> views,
                  Inside inside) {
  std::vector<double> mm2, per_mm2(patches.size());
  double samples = 0, all_mm2 = 0;
  for (const WallPatch& patch : patches) {
    mm2.push_back(patch.outside_mm2 + (inside == Inside::kWall ? patch.inside_mm2 : 0.0));
    samples += patch.samples;
    all_mm2 += mm2.back();
  }
  std::vector<double> seen_mm2(views.size(), 0.0);
  for (std::size_t v = 0; v < views.size(); ++v) {
    for (const std::uint16_t i : views[v]) seen_mm2[v] += mm2[i];
  }
  // Samples that each view adds to what it sees [1/mm2].
  std::vector<double> adds(views.size(), samples / all_mm2 / static_cast<double>(views.size()));
  const auto add_up = [&] {
    std::fill(per_mm2.begin(), per_mm2.end(), kUnseen.fliers * samples / all_mm2);
    for (std::size_t v = 0; v < views.size(); ++v) {
      for (const std::uint16_t i : views[v]) per_mm2[i] += adds[v];
    }
  };
  for (int round = 0; round < kUnseen.rounds; ++round) {
    add_up();
    for (std::size_t i = 0; i < patches.size(); ++i) per_mm2[i] = patches[i].samples / per_mm2[i];
    for (std::size_t v = 0; v < views.size(); ++v) {
      double more = 0;
      for (const std::uint16_t i : views[v]) more += per_mm2[i];
      adds[v] *= seen_mm2[v] > 0 ? more / seen_mm2[v] : 0.0;
    }
  }
  add_up();
  double log = 0;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    log += patches[i].samples * std::log(per_mm2[i]) - mm2[i] * per_mm2[i];
  }
  return log;
}

}  // namespace

double LogOddsOfCut(const LookedAtTube& tube, const hal::SurfaceFrame& frame,
                    const OpeningBorder& border, std::span<const Eigen::Vector2d> wall,
                    double reach_mm) {
  const std::vector<WallPatch> patches = PatchesAbout(tube, frame, border, wall, reach_mm);
  const std::vector<PatchesSeen> views = FindViews(tube, frame, patches);
  const bool has_samples = std::any_of(patches.begin(), patches.end(),
                                       [](const WallPatch& patch) { return patch.samples > 0; });
  if (!has_samples) return 0.0;
  return LogOfViews(patches, views, Inside::kNoWall) - LogOfViews(patches, views, Inside::kWall);
}

}  // namespace bendloop::pipeline
