// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/end_to_end.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "firmware-host/cad/tube_piece.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;

// How far `b` begins behind the end of `a`, negative: before it; nothing: it does not go on there.
std::optional<double> ApartMm(const CadTube& a, bool a_first, const CadTube& b, bool b_first) {
  const double tolerance = MatchToleranceMm(a.pipe_radius_mm);
  if (std::abs(a.pipe_radius_mm - b.pipe_radius_mm) > tolerance / 4) return std::nullopt;
  const Vector3d out = a.spine.OutwardAt(a_first);
  if (!PointAtEachOther(out, b.spine.OutwardAt(b_first))) return std::nullopt;
  const Vector3d gap =
      (b_first ? b.spine.start : b.spine.end) - (a_first ? a.spine.start : a.spine.end);
  const double apart_mm = gap.dot(out), beside_mm = (gap - apart_mm * out).norm();
  if (beside_mm > std::max(tolerance, kBesideRadii * a.pipe_radius_mm) ||
      std::abs(apart_mm) > kApartRadii * a.pipe_radius_mm) {
    return std::nullopt;
  }
  return apart_mm;
}

std::string NoteOf(bool is_first, const NextTube& next) {
  char text[160];
  std::snprintf(
      text, sizeof text,
      "tube %zu of the file (--list) goes on in line at the %s end, %.3f mm %s: it is not "
      "in the rows",
      next.tube + 1, is_first ? "first" : "last", std::abs(next.apart_mm),
      next.apart_mm < 0 ? "before it" : "behind it");
  return text;
}

void Note(CadTube& tube, bool is_first, const NextTube& next) {
  tube.next.push_back(next);
  tube.placed_notes.push_back(NoteOf(is_first, next));
  tube.placed_notes_reversed.push_back(NoteOf(!is_first, next));
}

}  // namespace

void NoteEndToEnd(std::vector<CadTube>& tubes) {
  const auto is_tube = [](const CadTube& t) { return !t.is_wire && t.problems.empty(); };
  for (std::size_t i = 0; i < tubes.size(); ++i) {
    for (std::size_t j = i + 1; is_tube(tubes[i]) && j < tubes.size(); ++j) {
      // Pieces of one body are told of otherwise (left_out.h).
      if (!is_tube(tubes[j]) || tubes[i].body == tubes[j].body) continue;
      for (const bool i_first : {true, false}) {
        for (const bool j_first : {true, false}) {
          const auto apart_mm = ApartMm(tubes[i], i_first, tubes[j], j_first);
          if (!apart_mm) continue;
          Note(tubes[i], i_first, {j, *apart_mm});
          Note(tubes[j], j_first, {i, *apart_mm});
        }
      }
    }
  }
}

}  // namespace bendloop::host
