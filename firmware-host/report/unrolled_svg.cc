// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/unrolled_svg.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware-host/text/table.h"
#include "hal/angles.h"
#include "hal/spine.h"
#include "hal/tube_features.h"

namespace bendloop::host {
namespace {

// [px] The picture, and what is left for the numbers beside it.
constexpr double kPaperWidth = 640, kPaperHeight = 200, kPaperLeft = 44, kPaperBelow = 28,
                 kPaperMargin = 14;
constexpr double kOblique = 5.0;  // [sigma] ends that are drawn as they are cut

// Places on the paper, seen from outside: mm along the tube to the right, so degrees around it grow
// downwards.
struct Paper {
  double length_mm, pipe_radius_mm;

  double X(double along_mm) const {
    return kPaperLeft + kPaperMargin +
           (kPaperWidth - kPaperLeft - 2 * kPaperMargin) * along_mm / length_mm;
  }
  double Y(double around_deg) const {
    return (kPaperHeight - kPaperBelow) * (0.5 + std::remainder(around_deg, 360.0) / 360.0);
  }
  std::string At(double along_mm, double around_deg) const {
    return Fixed(X(along_mm), 1) + "," + Fixed(Y(around_deg), 1) + " ";
  }
};

std::string PaperText(double x, double y, const std::string& text) {
  return "<text x=\"" + Fixed(x, 1) + "\" y=\"" + Fixed(y, 1) +
         "\" font-size=\"11\" text-anchor=\"middle\" fill=\"currentColor\">" + text + "</text>";
}

bool IsOblique(const std::optional<pipeline::EndCutFound>& end) {
  return end && end->cut.obliquity_deg > kOblique * end->obliquity_sigma_deg;
}

// Beyond the plane, where the border is none.
double BeyondPlaneMm(const std::optional<pipeline::EndCutFound>& end, double around_deg) {
  if (!end || end->border.empty()) return 0.0;
  const auto nearest =
      std::min_element(end->border.begin(), end->border.end(),
                       [&](const pipeline::BorderPlace& a, const pipeline::BorderPlace& b) {
                         return std::abs(std::remainder(a.around_deg - around_deg, 360.0)) <
                                std::abs(std::remainder(b.around_deg - around_deg, 360.0));
                       });
  return nearest->beyond_mm;
}

// Where the bevel of an end begins, dashed.
std::string BevelLine(const Paper& paper, const std::optional<pipeline::EndCutFound>& end,
                      bool at_start) {
  if (!end || !end->bevel) return "";
  const double along_mm =
      at_start ? end->bevel->length_mm : paper.length_mm - end->bevel->length_mm;
  return "<polyline fill=\"none\" stroke=\"currentColor\" stroke-dasharray=\"3 2\" points=\"" +
         paper.At(along_mm, -179) + paper.At(along_mm, 179) + "\"/>";
}

std::string EndLine(const Paper& paper, const std::optional<pipeline::EndCutFound>& end,
                    bool at_start) {
  const bool is_oblique = IsOblique(end);
  const double slope = is_oblique ? std::tan(end->cut.obliquity_deg * hal::kRadiansPerDegree) : 0.0;
  std::string svg = "<polyline fill=\"none\" stroke=\"currentColor\" points=\"";
  for (int around_deg = -179; around_deg <= 179; around_deg += 2) {
    const double turn = (around_deg - (is_oblique ? end->cut.around_deg : 0.0));
    const double beyond_mm =
        paper.pipe_radius_mm * slope * std::cos(turn * hal::kRadiansPerDegree) +
        BeyondPlaneMm(end, around_deg);
    svg += paper.At(at_start ? -beyond_mm : paper.length_mm + beyond_mm, around_deg);
  }
  return svg + "\"/>";
}

// The border of an opening, a point of it for each few degrees.
std::string OpeningLine(const Paper& paper, const hal::WallOpening& opening) {
  constexpr int kPoints = 48;
  const double axis = opening.axis_deg * hal::kRadiansPerDegree;
  const double half_line_mm = 0.5 * (opening.length_mm - opening.width_mm);
  std::string svg =
      "<polygon fill=\"currentColor\" fill-opacity=\"0.25\" stroke=\"currentColor\" points=\"";
  for (int i = 0; i < kPoints; ++i) {
    const double turn = 360.0 * (i + 0.5) / kPoints * hal::kRadiansPerDegree;
    const double u =
        0.5 * opening.width_mm * std::cos(turn) + std::copysign(half_line_mm, std::cos(turn));
    const double v = 0.5 * opening.width_mm * std::sin(turn);
    const double along_mm = u * std::cos(axis) - v * std::sin(axis);
    const double across_mm = u * std::sin(axis) + v * std::cos(axis);
    // Not beyond the edge of the paper, where the rest would be on its other side.
    const double middle_deg = std::remainder(opening.around_deg, 360.0);
    const double around_deg =
        middle_deg -
        std::asin(std::clamp(across_mm / paper.pipe_radius_mm, -1.0, 1.0)) * hal::kDegreesPerRadian;
    svg += paper.At(opening.along_mm + along_mm, std::clamp(around_deg, -179.9, 179.9));
  }
  return svg + "\"/>";
}

// A dent: the circle that has its area; how deep it is stands in the table.
std::string DentLine(const Paper& paper, const pipeline::DentFound& dent) {
  constexpr int kPoints = 32;
  std::string svg =
      "<polygon fill=\"currentColor\" fill-opacity=\"0.12\" stroke=\"currentColor\" "
      "stroke-dasharray=\"3 2\" points=\"";
  const double middle_deg = std::remainder(dent.around_deg, 360.0);
  for (int i = 0; i < kPoints; ++i) {
    const double turn = 360.0 * i / kPoints * hal::kRadiansPerDegree;
    const double around_deg = middle_deg + 0.5 * dent.size_mm * std::sin(turn) /
                                               paper.pipe_radius_mm * hal::kDegreesPerRadian;
    svg += paper.At(dent.along_mm + 0.5 * dent.size_mm * std::cos(turn),
                    std::clamp(around_deg, -179.9, 179.9));
  }
  return svg + "\"/>";
}

// A weld seam: straight all along, while the angles are counted anew from each bend's plane.
std::string SeamLine(const Paper& paper, const std::optional<pipeline::SeamFound>& seam,
                     const std::vector<hal::SpineSegment>& segments) {
  if (!seam) return "";
  std::string svg = "<path fill=\"none\" stroke=\"currentColor\" stroke-dasharray=\"9 3\" d=\"";
  double around_deg = seam->around_deg;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const hal::SpineSegment& segment = segments[k];
    if (k > 0) {
      around_deg -= hal::AroundDeg(hal::AroundZero(segments, k - 1), segment.tangent,
                                   hal::AroundZero(segments, k));
    }
    svg += "M" + paper.At(segment.from_start_mm, around_deg) + "L" +
           paper.At(segment.from_start_mm + segment.length_mm, around_deg);
  }
  return svg + "\"/>";
}

bool HasEdge(const std::optional<pipeline::EndCutFound>& end) {
  return end && (end->bevel || end->burr || !end->border.empty());
}

std::string PaperAxes(const Paper& paper, const std::vector<hal::SpineSegment>& segments) {
  std::string svg;
  for (const hal::SpineSegment& segment : segments) {
    if (!segment.is_arc() || !(segment.length_mm > 0)) continue;
    const double from = paper.X(segment.from_start_mm);
    svg += "<rect x=\"" + Fixed(from, 1) + "\" y=\"0\" width=\"" +
           Fixed(paper.X(segment.from_start_mm + segment.length_mm) - from, 1) + "\" height=\"" +
           Fixed(kPaperHeight - kPaperBelow, 1) +
           "\" fill=\"currentColor\" fill-opacity=\"0.07\"/>";
  }
  for (const int around_deg : {-90, 0, 90}) {
    const std::string y = Fixed(paper.Y(around_deg), 1);
    svg +=
        "<line x1=\"" + Fixed(kPaperLeft, 1) + "\" x2=\"" + Fixed(kPaperWidth, 1) + "\" y1=\"" + y +
        "\" y2=\"" + y + "\" stroke=\"currentColor\" stroke-opacity=\"0.25\"/>" +
        PaperText(0.5 * kPaperLeft, paper.Y(around_deg) + 4, std::to_string(around_deg) + "&#176;");
  }
  for (const double part : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    svg += PaperText(paper.X(part * paper.length_mm), kPaperHeight - 10,
                     Fixed(part * paper.length_mm, 0) + (part == 1.0 ? " mm" : ""));
  }
  return svg;
}

}  // namespace

std::string EndProfileSvg(const pipeline::EndForm& end, double pipe_radius_mm) {
  if (end.profile.size() < 2) return "";
  constexpr double kWidth = 120, kHeight = 36;
  const double far_mm = end.profile.back().from_end_mm;
  const double high_mm = std::max(end.Widest().radius_mm - pipe_radius_mm, 1e-6);
  std::string svg = "<svg role=\"img\" aria-label=\"radius by place\" width=\"" + Fixed(kWidth, 0) +
                    "\" height=\"" + Fixed(kHeight, 0) + "\" viewBox=\"0 0 " + Fixed(kWidth, 0) +
                    " " + Fixed(kHeight, 0) +
                    "\"><polyline fill=\"none\" stroke=\"currentColor\" points=\"";
  for (const pipeline::RadiusAt& at : end.profile) {
    svg += Fixed(kWidth * (1 - at.from_end_mm / far_mm), 1) + "," +
           Fixed(kHeight - 4 - (kHeight - 8) * (at.radius_mm - pipe_radius_mm) / high_mm, 1) + " ";
  }
  return svg + "\"/></svg>";
}

std::string UnrolledSvg(const pipeline::Measurement& m) {
  const Paper paper{hal::SpineLength(m.tube.program), m.tube.pipe_radius_mm};
  const bool has_any = !m.features.openings.empty() || !m.dents.empty() || m.seam ||
                       IsOblique(m.features.first_end) || IsOblique(m.features.last_end) ||
                       HasEdge(m.features.first_end) || HasEdge(m.features.last_end);
  if (!has_any || !(paper.length_mm > 0) || !(paper.pipe_radius_mm > 0)) return "";
  const auto segments = hal::SpineSegments(m.tube.program, m.tube.X_WT);
  std::string svg =
      "<svg role=\"img\" aria-label=\"the surface unrolled: length by angle\" viewBox=\"0 0 " +
      Fixed(kPaperWidth, 0) + " " + Fixed(kPaperHeight, 0) + "\">" + PaperAxes(paper, segments) +
      EndLine(paper, m.features.first_end, true) + EndLine(paper, m.features.last_end, false) +
      BevelLine(paper, m.features.first_end, true) + BevelLine(paper, m.features.last_end, false);
  for (const pipeline::OpeningFound& found : m.features.openings) {
    svg += OpeningLine(paper, found.opening);
  }
  for (const pipeline::DentFound& dent : m.dents) svg += DentLine(paper, dent);
  svg += SeamLine(paper, m.seam, segments);
  return svg + "</svg>";
}

}  // namespace bendloop::host
