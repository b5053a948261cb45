// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "config/fields.h"

namespace bendloop::config {

namespace {

constexpr std::size_t kMaxOpenings = 100;

void VisitPlace(FieldVisitor& v, OpeningConfig& opening) {
  v.OptionalNumber("from_start_mm", opening.from_start_mm, {0, 100000});
  v.OptionalNumber("from_end_mm", opening.from_end_mm, {0, 100000});
  v.Number("around_deg", opening.around_deg, {-180, 360}, Need::kRequired);
}

void VisitOpeningTolerances(FieldVisitor& v, OpeningConfig& opening) {
  v.Number("place_tolerance_mm", opening.place_tolerance_mm, {0.001, 100});
  v.Number("around_tolerance_deg", opening.around_tolerance_deg, {0.001, 180});
  v.Number("size_tolerance_mm", opening.size_tolerance_mm, {0.001, 100});
}

void VisitFeatures(FieldVisitor& v, PartConfig& part) {
  std::size_t holes = part.holes.size();
  v.Tables("hole", holes, kMaxOpenings, [&](FieldVisitor& h, std::size_t i) {
    if (i >= part.holes.size()) part.holes.resize(i + 1);
    OpeningConfig& hole = part.holes[i];
    VisitPlace(h, hole);
    h.Number("diameter_mm", hole.length_mm, {0.1, 1000}, Need::kRequired);
    hole.width_mm = hole.length_mm;
    // A radial one has no lean in its file, as always.
    for (const auto& [key, lean_deg] : {std::pair{"lean_along_deg", &hole.lean_along_deg},
                                        {"lean_around_deg", &hole.lean_around_deg}}) {
      if (h.Present(key, *lean_deg != 0)) h.Number(key, *lean_deg, {-60, 60});
    }
    VisitOpeningTolerances(h, hole);
  });
  std::size_t slots = part.slots.size();
  v.Tables("slot", slots, kMaxOpenings, [&](FieldVisitor& s, std::size_t i) {
    if (i >= part.slots.size()) part.slots.resize(i + 1);
    OpeningConfig& slot = part.slots[i];
    VisitPlace(s, slot);
    s.Number("length_mm", slot.length_mm, {0.1, 1000}, Need::kRequired);
    s.Number("width_mm", slot.width_mm, {0.1, 1000}, Need::kRequired);
    s.Number("axis_deg", slot.axis_deg, {-90, 90});
    VisitOpeningTolerances(s, slot);
    s.Number("axis_tolerance_deg", slot.axis_tolerance_deg, {0.001, 90});
  });
  const bool has_end = part.ends.obliquity_tolerance_deg || !(part.ends.first == hal::EndCut()) ||
                       !(part.ends.last == hal::EndCut());
  if (!v.Present("end", has_end)) return;
  v.Table("end", Need::kOptional, [&](FieldVisitor& e) {
    e.Number("first_obliquity_deg", part.ends.first.obliquity_deg, {0, 60});
    e.Number("first_around_deg", part.ends.first.around_deg, {-180, 360});
    e.Number("last_obliquity_deg", part.ends.last.obliquity_deg, {0, 60});
    e.Number("last_around_deg", part.ends.last.around_deg, {-180, 360});
    e.OptionalNumber("obliquity_tolerance_deg", part.ends.obliquity_tolerance_deg, {0.001, 60});
  });
}

}  // namespace

void VisitPart(FieldVisitor& v, PartConfig& part) {
  v.Text("name", part.name, Need::kRequired);
  v.Integer("part_number", part.part_number, 1, 0xffffffff, Need::kRequired);
  // A diameter is only another way of writing the radius.
  if (std::optional<double> diameter; v.Present("pipe_diameter_mm", false)) {
    v.OptionalNumber("pipe_diameter_mm", diameter, {1, 1000});
    part.pipe_radius_mm = diameter.value_or(0) / 2;
  }
  v.Number("pipe_radius_mm", part.pipe_radius_mm, {0.5, 500});
  v.OptionalNumber("wall_mm", part.wall_mm, {0.05, 100});
  v.OptionalNumber("bend_radius_mm", part.bend_radius_mm, {1, 10000});

  std::size_t row_count = part.rows.rows.size();
  v.Tables("row", row_count, kMaxRows, [&](FieldVisitor& r, std::size_t i) {
    if (i >= part.rows.rows.size()) part.rows.rows.resize(i + 1);
    hal::BendRow& row = part.rows.rows[i];
    r.Number("length_mm", row.length_mm, {0, 20000}, Need::kRequired);
    r.Number("rotation_deg", row.rotation_deg, {-180, 180}, Need::kOptional);
    r.Number("angle_deg", row.angle_deg, {0, 360, true}, Need::kOptional);
    r.OptionalNumber("bend_radius_mm", row.bend_radius_mm, {1, 10000});
  });
  if (v.Present("nominal", !part.xyz_mm.empty())) {
    v.Table("nominal", Need::kOptional, [&](FieldVisitor& n) {
      n.Points("xyz_mm", part.xyz_mm, {-100000, 100000}, kMaxRows + 1);
    });
  }
  VisitFeatures(v, part);
  v.Table("tolerance", Need::kOptional, [&](FieldVisitor& t) {
    t.Number("length_mm", part.tolerance.length_mm, {0.001, 100});
    t.Number("rotation_deg", part.tolerance.rotation_deg, {0.001, 90});
    t.Number("angle_deg", part.tolerance.angle_deg, {0.001, 90});
    t.Number("envelope_mm", part.tolerance.envelope_mm, {0.001, 100});
    t.Number("surface_mm", part.tolerance.surface_mm, {0.001, 100});
    t.OptionalNumber("straightness_mm", part.tolerance.straightness_mm, {0.001, 100});
    t.OptionalNumber("dent_depth_mm", part.tolerance.dent_depth_mm, {0.001, 100});
  });
  v.Table("material", Need::kOptional, [&](FieldVisitor& m) {
    m.Number("springback_at_20_deg", part.material.springback_at_20_deg, {-5, 15});
    m.Number("springback_at_120_deg", part.material.springback_at_120_deg, {-10, 45});
    m.Number("elongation_percent", part.material.elongation_percent, {-5, 25});
  });
}

}  // namespace bendloop::config
