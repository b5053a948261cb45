// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/text/findings_text.h"

#include <algorithm>
#include <string>
#include <vector>

#include "firmware-host/text/sentence.h"
#include "firmware-host/text/shown_value.h"
#include "firmware-host/text/table.h"
#include "hal/spine.h"

namespace bendloop::host {
namespace {

std::string FitText(const pipeline::Measurement& m) {
  std::string out = Below(
      "pipe radius " +
      Fixed(m.tube.pipe_radius_mm, SigmaDecimals(m.pipe_radius_sigma_mm, kDecimals)) + " +- " +
      ShowSigma(m.pipe_radius_sigma_mm) + " mm; " +
      (m.tube.program.rows.empty() ? "" : Plural(m.tube.program.bend_count(), "bend") + "; ") +
      "+- is 1 sigma");
  out +=
      Below("fit: " + Plural(m.fit.samples, "sample") + ", " + Plural(m.fit.outliers, "outlier") +
            "; distance median " + Fixed(m.fit.median_abs_distance_mm, kDecimals) + ", rms " +
            Fixed(m.fit.rms_distance_mm, kDecimals) + ", 95 % below " +
            Fixed(m.fit.p95_abs_distance_mm, kDecimals) + " mm");
  if (m.coverage > 0) {
    out += Below("coverage " + Fixed(100 * m.coverage, 1) + " % of the spine, longest gap " +
                 Fixed(m.longest_gap_mm, 1) + " mm");
  }
  return out;
}

std::string BendShapesText(const std::vector<pipeline::BendShape>& shapes) {
  std::string out;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const pipeline::BendShape& shape = shapes[i];
    out += Below("bend " + std::to_string(i + 1) + ": ovality " + Fixed(shape.ovality_percent, 2) +
                 " +- " + Fixed(shape.ovality_sigma_percent, 2) + " %, outer wall sunk in by " +
                 Fixed(shape.outer_wall_mm, kDecimals) + " +- " +
                 Fixed(shape.outer_wall_sigma_mm, kDecimals) + " mm");
  }
  return out;
}

// What a person at the machine should know of the tube's form: what is beyond its own sigma.
std::string FormText(const pipeline::Measurement& m) {
  std::string out;
  const pipeline::StraightForm* worst = nullptr;
  for (const pipeline::StraightForm& straight : m.straights) {
    if (straight.length_mm > 0 && (!worst || straight.height_mm > worst->height_mm)) {
      worst = &straight;
    }
  }
  if (worst && worst->height_mm > 3 * worst->sigma_mm) {
    out += Below("straightness: " + Fixed(worst->height_mm, kDecimals) + " +- " +
                 Fixed(worst->sigma_mm, kDecimals) + " mm on " + Fixed(worst->length_mm, 0) +
                 " mm (L/" + Fixed(worst->length_mm / worst->height_mm, 0) + "), the worst, row " +
                 std::to_string(worst - m.straights.data() + 1));
  }
  if (!m.bend_easings.empty()) {
    std::string lengths;
    for (std::size_t i = 0; i < m.bend_easings.size(); ++i) {
      lengths += (i == 0 ? " " : ", ") + Fixed(m.bend_easings[i].length_mm, 1);
    }
    out += Below("bends ease in and out over" + lengths + " mm");
  }
  for (const pipeline::DentFound& dent : m.dents) {
    out +=
        Below("dent: " + Fixed(dent.depth_mm, 2) + " +- " + Fixed(dent.sigma_mm, 2) + " mm deep, " +
              Fixed(dent.area_mm2, 1) + " +- " + Fixed(dent.area_sigma_mm2, 1) +
              " mm2 where half as deep, at " + Fixed(dent.along_mm, 1) + " +- " +
              Fixed(dent.along_sigma_mm, 1) + " mm along the spine, " + Fixed(dent.around_deg, 1) +
              " +- " + Fixed(dent.around_sigma_deg, 1) + " degrees around");
  }
  if (m.seam) {
    out += Below("weld seam: " + Fixed(m.seam->height_mm, 3) + " +- " + Fixed(m.seam->sigma_mm, 3) +
                 " mm high and " + Fixed(m.seam->width_mm, 1) + " mm wide, at " +
                 Fixed(m.seam->around_deg, 1) + " +- " + Fixed(m.seam->around_sigma_deg, 1) +
                 " degrees around on the first straight");
  }
  for (const pipeline::WrinklesFound& wrinkles : m.wrinkles) {
    out += Below("bend " + std::to_string(wrinkles.bend + 1) + ": wrinkles on its inner side, " +
                 Fixed(wrinkles.height_mm, 3) + " +- " + Fixed(wrinkles.sigma_mm, 3) +
                 " mm from crest to trough");
  }
  for (std::size_t i = 0; i < m.passes.size(); ++i) {
    out += Below("pass " + std::to_string(i + 1) + ": moved by " +
                 Fixed(m.passes[i].move_mm.norm(), kDecimals) + " mm and " +
                 Fixed(m.passes[i].turn_deg.norm(), kDecimals) + " degrees to meet the others");
  }
  return out;
}

// What an end has beside its plane.
std::string EdgeText(const std::string& which, const pipeline::EndCutFound& end) {
  std::string out;
  if (end.bevel) {
    out += Below(which + "bevelled over " + Fixed(end.bevel->length_mm, 2) + " +- " +
                 Fixed(end.bevel->length_sigma_mm, 2) + " mm, " + Fixed(end.bevel->depth_mm, 2) +
                 " +- " + Fixed(end.bevel->depth_sigma_mm, 2) + " mm deep, at " +
                 Fixed(end.bevel->angle_deg, 1) + " +- " + Fixed(end.bevel->angle_sigma_deg, 1) +
                 " degrees to the axis");
  }
  if (end.burr) {
    out += Below(which + "burr of " + Fixed(end.burr->height_mm, 2) + " +- " +
                 Fixed(end.burr->sigma_mm, 2) + " mm at " + Fixed(end.burr->around_deg, 0) +
                 " degrees around, on " + Fixed(100 * end.burr->part, 0) + " % of the turn");
  }
  if (!end.border.empty()) {
    const auto [least, most] =
        std::minmax_element(end.border.begin(), end.border.end(),
                            [](const pipeline::BorderPlace& a, const pipeline::BorderPlace& b) {
                              return a.beyond_mm < b.beyond_mm;
                            });
    out += Below(which + "no plane; its border lies from " + Fixed(least->beyond_mm, 2) + " +- " +
                 Fixed(least->sigma_mm, 2) + " mm (at " + Fixed(least->around_deg, 0) +
                 " degrees) to " + Fixed(most->beyond_mm, 2) + " +- " + Fixed(most->sigma_mm, 2) +
                 " mm (at " + Fixed(most->around_deg, 0) + ") beyond the nearest one");
  }
  return out;
}

// Ends that are certainly not square (5 sigma), holes and slots.
std::string FeaturesText(const pipeline::Measurement& m) {
  std::string out;
  const auto degrees = [](double value, double sigma) {
    return Fixed(value, 2) + " +- " + Fixed(sigma, 2) + " degrees";
  };
  const auto mm = [](double value, double sigma) {
    return Fixed(value, kDecimals) + " +- " + Fixed(sigma, kDecimals) + " mm";
  };
  for (const auto* end : {&m.features.first_end, &m.features.last_end}) {
    if (!*end || (*end)->cut.obliquity_deg < 5 * (*end)->obliquity_sigma_deg) continue;
    out += Below(std::string(end == &m.features.first_end ? "first" : "last") + " end: cut " +
                 degrees((*end)->cut.obliquity_deg, (*end)->obliquity_sigma_deg) +
                 " oblique, longest at " +
                 degrees((*end)->cut.around_deg, (*end)->around_sigma_deg) + " around");
  }
  for (const auto* end : {&m.features.first_end, &m.features.last_end}) {
    if (!*end) continue;
    out += EdgeText(end == &m.features.first_end ? "first end: " : "last end: ", **end);
  }
  for (const auto* end : {&m.first_end, &m.last_end}) {
    if (end->profile.empty()) continue;
    const pipeline::RadiusAt& widest = end->Widest();
    const bool is_bead = end->is_bead();
    out += Below(std::string(end == &m.first_end ? "first" : "last") +
                 " end: " + (is_bead ? "bead" : "wider") + " from " +
                 mm(end->begins_mm, end->begins_sigma_mm) +
                 (is_bead ? " to " + mm(end->returns_mm, end->returns_sigma_mm) : "") +
                 " before its end, radius up to " + mm(widest.radius_mm, widest.sigma_mm));
  }
  const double length_mm = hal::SpineLength(m.tube.program);
  for (const pipeline::OpeningFound& found : m.features.openings) {
    const hal::WallOpening& opening = found.opening;
    const bool from_end = opening.along_mm > 0.5 * length_mm;
    std::string size = mm(opening.width_mm, found.sigma.width_mm);
    if (!opening.is_hole()) {
      size = mm(opening.length_mm, found.sigma.length_mm) + " long, " + size + " wide, axis at " +
             degrees(opening.axis_deg, found.sigma.axis_deg);
    }
    if (opening.lean_along_deg != 0 || opening.lean_around_deg != 0) {
      size += ", leaning " + degrees(opening.lean_along_deg, found.sigma.lean_along_deg) +
              " along and " + degrees(opening.lean_around_deg, found.sigma.lean_around_deg) +
              " around";
    }
    out +=
        Below((opening.is_hole() ? "hole: " : "slot: ") + size + ", " +
              mm(from_end ? length_mm - opening.along_mm : opening.along_mm, found.sigma.along_mm) +
              (from_end ? " from the last end, " : " from the first end, ") +
              degrees(opening.around_deg, found.sigma.around_deg) + " around");
  }
  return out;
}

}  // namespace

std::string FindingsText(const pipeline::Measurement& m) {
  return FitText(m) + BendShapesText(m.bend_shapes) + FormText(m) + FeaturesText(m);
}

}  // namespace bendloop::host
