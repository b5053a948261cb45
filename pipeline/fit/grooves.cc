// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/grooves.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "hal/spine.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/points/input_checks.h"

namespace bendloop::pipeline {
namespace {

struct GrooveSettings {
  // [of r_P] 1 sigma of the points; smoother walls have none, nor do such grooves matter.
  double rough = 0.015, least = 0.01;
  std::size_t enough_points = 100'000;
  // [of r_P] Of a piece of the wall, along it: less than half a groove; so many are compared with
  // each other, over which bows and dents hardly lie elsewhere.
  double long_part = 0.1;
  std::size_t together = 15;
  // [of r_P] Straights of less are bends' ends.
  double shortest = 1.5;
  // [sigma] of what noise leaves of it, and [of the points' variance] what grooves make of it.
  double insist = 8.0, share = 0.3;
};
constexpr GrooveSettings kGrooves;
constexpr std::size_t kColumns = 12;  // around

// Points of a piece of the wall.
struct GroovePiece {
  double n = 0, sum = 0, squares = 0;
};

// What pieces side by side along the tube have of their own, and what is left within each (one-way
// analysis of variance with random effects, pieces of any number of points).
struct GrooveScatter {
  double between = 0, pieces = 0, counted = 0;
  double within = 0, freedom = 0;

  void Add(std::span<const GroovePiece> compared) {
    double n = 0, sum = 0, of_pieces = 0, n2 = 0, filled = 0;
    for (const GroovePiece& piece : compared) {
      if (piece.n < 1) continue;
      const double own = piece.sum * piece.sum / piece.n;
      within += piece.squares - own;
      freedom += piece.n - 1;
      n += piece.n, sum += piece.sum, n2 += piece.n * piece.n;
      of_pieces += own;
      filled += 1;
    }
    if (filled < 2) return;
    between += of_pieces - sum * sum / n;
    pieces += filled - 1;
    counted += n - n2 / n;
  }
  double Noise() const { return within / freedom; }
  double OfPieces() const { return (between - pieces * Noise()) / counted; }
  double OfPiecesSigma() const {
    return Noise() / counted * std::sqrt(2.0 * pieces * (1.0 + pieces / freedom));
  }
};

GrooveScatter ScatterAlong(const SegmentPoints& points, double length_mm, double r_mm,
                           double limit_mm) {
  const double row_mm = kGrooves.long_part * r_mm;
  const auto stretches = static_cast<std::size_t>(
      std::ceil(length_mm / (row_mm * static_cast<double>(kGrooves.together))));
  const std::size_t rows = stretches * kGrooves.together;
  std::vector<GroovePiece> pieces(rows * kColumns);
  for (std::size_t i = 0; i < points.size; ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    const double distance_mm = points.distance[at], along = points.x[at] / row_mm;
    if (!(along >= 0 && along < static_cast<double>(rows))) continue;
    if (!(std::abs(distance_mm) < limit_mm)) continue;
    const double around = std::atan2(points.z[at], points.y[at]) / (2.0 * std::numbers::pi) + 0.5;
    const auto row = static_cast<std::size_t>(along);
    const auto column = std::min(kColumns - 1, static_cast<std::size_t>(around * kColumns));
    GroovePiece& piece = pieces[column * rows + row];
    piece.n += 1, piece.sum += distance_mm, piece.squares += distance_mm * distance_mm;
  }
  GrooveScatter scatter;
  for (std::size_t i = 0; i < pieces.size(); i += kGrooves.together) {
    scatter.Add(std::span(pieces).subspan(i, kGrooves.together));
  }
  return scatter;
}

}  // namespace

std::vector<GroovesFound> FindGrooves(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                      double reach_mm) {
  const double r_mm = fit.tube.pipe_radius_mm;
  if (!(fit.sigma_mm > kGrooves.rough * r_mm)) return {};
  const auto segments = hal::SpineSegments(fit.tube.program, fit.tube.X_WT);
  const OwnedBlocks few = Thinned(blocks, StrideTo(CountPoints(blocks), kGrooves.enough_points));
  SurfaceAssignment points;
  AssignPoints(SegmentFrames(segments, 0.0, fit.flattening), r_mm, few, reach_mm, points);
  std::vector<GroovesFound> found;
  for (std::size_t k = 0; k < segments.size(); k += 2) {
    if (segments[k].length_mm < kGrooves.shortest * r_mm) continue;
    const GrooveScatter scatter =
        ScatterAlong(points.segments[k], segments[k].length_mm, r_mm, kNoWeight * fit.sigma_mm);
    if (!(scatter.freedom > 0 && scatter.counted > 0)) continue;
    const double grooves_mm2 = scatter.OfPieces(), noise_mm2 = scatter.Noise();
    if (!(grooves_mm2 > kGrooves.insist * scatter.OfPiecesSigma())) continue;
    if (!(grooves_mm2 > kGrooves.share * (grooves_mm2 + noise_mm2))) continue;
    const double rms_mm = std::sqrt(grooves_mm2);
    if (rms_mm > kGrooves.least * r_mm) found.push_back({k / 2, rms_mm});
  }
  return found;
}

void SayGrooves(std::span<const GroovesFound> grooves, Measurement& measurement) {
  if (grooves.empty()) return;
  std::string straights;
  double rms_mm = 0;
  for (const GroovesFound& of : grooves) {
    straights += (straights.empty() ? "" : ", ") + std::to_string(of.straight + 1);
    rms_mm = std::max(rms_mm, of.rms_mm);
  }
  measurement.warnings.push_back(
      "the wall goes up and down along straight " + straights + ", by " + Mm(rms_mm) +
      " rms, as that of a corrugated hose or a threaded rod does: the pipe radius is one between "
      "its crests and troughs, and rows are those of its middle");
}

}  // namespace bendloop::pipeline
