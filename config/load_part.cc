// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "config/fields.h"
#include "config/load.h"
#include "config/parse_file.h"

namespace bendloop::config {
namespace {

constexpr double kMinBendDeg = 0.1;

std::string Mm(double value) { return NumberText(std::round(value * 1000) / 1000) + " mm"; }

std::string RowPath(std::size_t index, std::string_view key) {
  return "row[" + std::to_string(index + 1) + "]." + std::string(key);
}

// Fills in the bend radius of rows that leave it to the part.
void CheckRows(TomlDocument& document, PartConfig& part) {
  std::vector<hal::BendRow>& rows = part.rows.rows;
  if (rows.size() == 1) {
    return document.Report("row",
                           "found 1 row, expected at least 2: each bend has a row, and the "
                           "last row is the end length with angle 0");
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    hal::BendRow& row = rows[i];
    const bool is_last = i + 1 == rows.size();
    const bool may_touch = i > 0 && !is_last;  // the straight between two bends may be 0
    if (document.IsGood(RowPath(i, "length_mm")) && !may_touch && row.length_mm <= 0) {
      document.Report(RowPath(i, "length_mm"),
                      "found " + NumberText(row.length_mm) +
                          ", expected more than 0: the first and the last straight are clamped");
    }
    if (i == 0 && row.rotation_deg != 0) {
      document.Report(RowPath(i, "rotation_deg"),
                      "found " + NumberText(row.rotation_deg) +
                          ", expected 0: the first bend defines the plane from which the others "
                          "are counted");
    }
    if (is_last) {
      if (row.angle_deg != 0) {
        document.Report(RowPath(i, "angle_deg"),
                        "found " + NumberText(row.angle_deg) +
                            ", expected 0: the last row is the end length; add a row after this "
                            "one for the straight behind the last bend");
      }
      if (row.bend_radius_mm) {
        document.Report(RowPath(i, "bend_radius_mm"),
                        "found a bend radius, expected none: the last row has no bend");
      }
      row.bend_radius_mm.reset();
      row.rotation_deg = 0;
      continue;
    }
    if (document.IsGood(RowPath(i, "angle_deg")) && row.angle_deg < kMinBendDeg) {
      document.Report(RowPath(i, "angle_deg"),
                      "found " + NumberText(row.angle_deg) + ", expected a bend of at least " +
                          NumberText(kMinBendDeg) + "; only the last row has no bend");
    }
    if (!row.bend_radius_mm && document.IsGood("bend_radius_mm")) {
      row.bend_radius_mm = part.bend_radius_mm;
      if (!row.bend_radius_mm) {
        document.Report(RowPath(i, "bend_radius_mm"),
                        "found nothing, expected the bend radius here or one for all rows as "
                        "bend_radius_mm at the top of the file");
      }
    } else if (row.bend_radius_mm && document.IsGood("pipe_radius_mm") &&
               *row.bend_radius_mm <= part.pipe_radius_mm) {
      document.Report(RowPath(i, "bend_radius_mm"), "found " + NumberText(*row.bend_radius_mm) +
                                                        ", expected more than the pipe radius of " +
                                                        Mm(part.pipe_radius_mm));
    }
    row.rotation_deg = hal::WrapRotationDeg(row.rotation_deg);
  }
}

// Every pair of corners must leave room for the two arcs that round them.
void CheckPoints(TomlDocument& document, const PartConfig& part) {
  static constexpr std::string_view kPath = "nominal.xyz_mm";
  const std::vector<Eigen::Vector3d>& points = part.xyz_mm;
  if (!document.IsGood(kPath)) return;
  const auto report = [&](std::size_t index, const std::string& complaint) {
    document.Report(std::string(kPath) + "[" + std::to_string(index + 1) + "]", complaint);
  };
  if (points.size() < 3) {
    return document.Report(kPath, "found " + std::to_string(points.size()) +
                                      " points, expected at least 3: both ends and a corner for "
                                      "each bend");
  }
  if (!part.bend_radius_mm) {
    if (document.IsGood("bend_radius_mm")) {
      document.Report("bend_radius_mm",
                      "found nothing, expected the bend radius of the corners in nominal.xyz_mm");
    }
    return;
  }
  std::vector<double> tangent_mm(points.size(), 0);  // corner to tangent point
  for (std::size_t i = 1; i + 1 < points.size(); ++i) {
    const Eigen::Vector3d in = points[i] - points[i - 1];
    const Eigen::Vector3d out = points[i + 1] - points[i];
    if (in.norm() < 1e-3 || out.norm() < 1e-3) {
      return report(in.norm() < 1e-3 ? i : i + 1,
                    "found the same point twice, expected corners "
                    "that are apart");
    }
    const double angle_rad = std::atan2(in.cross(out).norm(), in.dot(out));
    const double angle_deg = angle_rad * 180 / std::numbers::pi;
    if (angle_deg < kMinBendDeg || angle_deg > 179.9) {
      return report(i, "found a bend of " + NumberText(std::round(angle_deg * 100) / 100) +
                           " degrees, expected 0.1 to 179.9 (bends of 180 degrees and more have "
                           "no corner: give the part as rows)");
    }
    tangent_mm[i] = *part.bend_radius_mm * std::tan(angle_rad / 2);
  }
  for (std::size_t i = 1; i < points.size(); ++i) {
    const double distance_mm = (points[i] - points[i - 1]).norm();
    const double needed_mm = tangent_mm[i - 1] + tangent_mm[i];
    const bool is_end = i == 1 || i + 1 == points.size();
    if (distance_mm < needed_mm - 1e-6 || (is_end && distance_mm <= needed_mm)) {
      report(i, "found this point " + Mm(distance_mm) + " from the one before, expected at least " +
                    Mm(needed_mm) + ", which the bends with a radius of " +
                    Mm(*part.bend_radius_mm) + " need");
    }
  }
}

// Each hole and slot has one place, and fits on the tube.
void CheckOpenings(TomlDocument& document, std::string_view table,
                   const std::vector<OpeningConfig>& openings, const PartConfig& part) {
  for (std::size_t i = 0; i < openings.size(); ++i) {
    const OpeningConfig& opening = openings[i];
    const auto path = [&](std::string_view key) {
      return std::string(table) + "[" + std::to_string(i + 1) + "]." + std::string(key);
    };
    const bool good_places =
        document.IsGood(path("from_start_mm")) && document.IsGood(path("from_end_mm"));
    if (good_places && opening.from_start_mm.has_value() == opening.from_end_mm.has_value()) {
      document.Report(path("from_start_mm"),
                      std::string("found ") +
                          (opening.from_start_mm ? "it and from_end_mm" : "nothing") +
                          ", expected either from_start_mm or from_end_mm: along the centre line, "
                          "from the end that is nearer");
    }
    const std::string_view width = table == "hole" ? "diameter_mm" : "width_mm";
    if (document.IsGood("pipe_radius_mm") && document.IsGood(path(width)) &&
        opening.width_mm >= 2 * part.pipe_radius_mm) {
      document.Report(path(width), "found " + NumberText(opening.width_mm) +
                                       ", expected less than the pipe's diameter of " +
                                       Mm(2 * part.pipe_radius_mm));
    }
    if (table == "slot" && document.IsGood(path("length_mm")) && document.IsGood(path(width)) &&
        opening.length_mm <= opening.width_mm) {
      document.Report(path("length_mm"), "found " + NumberText(opening.length_mm) +
                                             ", expected more than the width of " +
                                             Mm(opening.width_mm) +
                                             "; what is as long as wide is a [[hole]]");
    }
  }
}

void CheckPart(TomlDocument& document, PartConfig& part) {
  CheckOpenings(document, "hole", part.holes, part);
  CheckOpenings(document, "slot", part.slots, part);
  const bool has_radius = document.root().contains("pipe_radius_mm");
  const bool has_diameter = document.root().contains("pipe_diameter_mm");
  if (has_radius == has_diameter) {
    document.Report("pipe_radius_mm",
                    std::string("found ") + (has_radius ? "it and pipe_diameter_mm" : "nothing") +
                        ", expected either pipe_radius_mm or pipe_diameter_mm (outer)");
  }
  const bool radius_is_good = document.IsGood("pipe_radius_mm");
  if (radius_is_good && part.wall_mm && *part.wall_mm >= part.pipe_radius_mm) {
    document.Report("wall_mm", "found " + NumberText(*part.wall_mm) +
                                   ", expected less than the pipe radius of " +
                                   Mm(part.pipe_radius_mm));
  }
  if (radius_is_good && part.bend_radius_mm && *part.bend_radius_mm <= part.pipe_radius_mm) {
    document.Report("bend_radius_mm", "found " + NumberText(*part.bend_radius_mm) +
                                          ", expected more than the pipe radius of " +
                                          Mm(part.pipe_radius_mm));
  }
  const bool has_rows = document.root().contains("row");
  const bool has_points = document.root().contains("nominal");
  if (has_rows == has_points) {
    document.Report(has_rows ? "nominal" : "row",
                    std::string("found ") +
                        (has_rows ? "both [[row]] and [nominal]" : "no nominal") +
                        ", expected either [[row]] tables (LRA) or [nominal] with xyz_mm");
  } else if (has_rows && !part.rows.rows.empty()) {
    CheckRows(document, part);
  } else if (has_rows && document.IsGood("row")) {
    document.Report("row", "found no row, expected a row for each bend and one for the end");
  } else if (has_points) {
    CheckPoints(document, part);
  }
}

}  // namespace

hal::Result<PartConfig> ParsePart(std::string_view toml, std::string_view name) {
  return ParseDocument(toml, name, FileKind::kPart, {}, VisitPart, CheckPart, PartConfig());
}

hal::Result<PartConfig> LoadPart(const std::filesystem::path& file) {
  const hal::Result<std::string> text = ReadTextFile(file);
  if (!text) return hal::Fail(text.error());
  hal::Result<PartConfig> part = ParsePart(*text, file.string());
  if (part) part->file = std::filesystem::absolute(file).lexically_normal();
  return part;
}

}  // namespace bendloop::config
