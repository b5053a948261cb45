// SPDX-License-Identifier: Apache-2.0
#include "config/fields.h"

namespace bendloop::config {

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
