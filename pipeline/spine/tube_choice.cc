// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spine/tube_choice.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "hal/spine.h"
#include "pipeline/points/input_checks.h"

namespace bendloop::pipeline {
namespace {

// Which pieces of spine count. All by trial.
struct ChoiceSettings {
  // A piece is worth a word if it is longer than this part of the first tube, or than so many pipe
  // radii if it is as smooth.
  double piece = 0.2;
  double piece_radii = 6.0;
  // [of the first one's length] A longer one is a second tube and no scrap any more.
  double second_tube = 0.6;
  // [of a rough piece's length] A smooth one as long as this says that the rough one is no pipe.
  double pipe_too = 0.3;
};
constexpr ChoiceSettings kChoice;

// Pieces that may be pipes first, in their order. How many.
std::size_t PipesFirst(std::vector<SpinePolygon>& polygons, double pipe_radius_mm) {
  const std::vector<SpinePolygon> all = polygons;
  const auto rough = std::stable_partition(
      polygons.begin(), polygons.end(), [&all, pipe_radius_mm](const SpinePolygon& piece) {
        return std::none_of(all.begin(), all.end(), [&](const SpinePolygon& other) {
          return LengthOf(other) > kChoice.pipe_too * LengthOf(piece) &&
                 IsMuchRougher(piece, other, pipe_radius_mm);
        });
      });
  return static_cast<std::size_t>(rough - polygons.begin());
}

}  // namespace

hal::Result<SpinePolygon> ChooseTube(std::vector<SpinePolygon> polygons, double pipe_radius_mm,
                                     const std::optional<hal::BendProgram>& nominal,
                                     std::vector<double>& left_out_mm) {
  if (polygons.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "no tube of pipe radius " + Mm(pipe_radius_mm) +
                         " in the points: expected a surface curved like that" + kCloserLines);
  }
  if (nominal) {
    // With a nominal the tube is the piece of its length; others are neighbours in view. Even a
    // rough one may be it, where the pipe radius that was found is a neighbour's.
    const double nominal_mm = hal::SpineLength(*nominal);
    const auto off_mm = [nominal_mm](const SpinePolygon& piece) {
      return std::abs(LengthOf(piece) - nominal_mm);
    };
    return *std::min_element(polygons.begin(), polygons.end(),
                             [&](const auto& a, const auto& b) { return off_mm(a) < off_mm(b); });
  }
  const std::size_t pipes = PipesFirst(polygons, pipe_radius_mm);
  const double first_mm = LengthOf(polygons[0]);
  if (pipes > 1 && LengthOf(polygons[1]) > kChoice.second_tube * first_mm) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "two tubes in the points (" + Mm(first_mm) + " and " +
                         Mm(LengthOf(polygons[1])) +
                         " long), or one with a gap that is too long to bridge: scan one tube "
                         "at a time, and the gap again");
  }
  for (std::size_t i = 1; i < polygons.size(); ++i) {
    const double length_mm = LengthOf(polygons[i]);
    if (length_mm > kChoice.piece * first_mm ||
        (i < pipes && length_mm > kChoice.piece_radii * pipe_radius_mm)) {
      left_out_mm.push_back(length_mm);
    }
  }
  return polygons.front();
}

void SayLeftOut(const std::vector<double>& lengths_mm, std::vector<std::string>& warnings) {
  if (lengths_mm.empty()) return;
  const std::string all_mm = Mm(std::accumulate(lengths_mm.begin(), lengths_mm.end(), 0.0));
  warnings.push_back(
      lengths_mm.size() == 1
          ? "another piece of tube in view, " + all_mm +
                " long, is left out: where it belongs to this one, scan the gap between them again"
          : std::to_string(lengths_mm.size()) + " other pieces of tube in view, together " +
                all_mm +
                " long, are left out: where they belong to this one, scan the gaps between them "
                "again");
}

}  // namespace bendloop::pipeline
