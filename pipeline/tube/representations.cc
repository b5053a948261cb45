// SPDX-License-Identifier: Apache-2.0
#include "pipeline/tube/representations.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <span>
#include <string>

#include "hal/angles.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// What numbers rounded for people leave.
struct RoundingLimits {
  // [mm] What coordinates rounded to hundredths of a millimetre can take from a straight of length
  // 0.
  double overlap_mm = 0.01;
  // [rad] Below this angle a corner has no plane that numbers could tell.
  double collinear_rad = 1e-9;
};
constexpr RoundingLimits kRounding;

std::string Number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

// Angle from `from` to `to`, right-handed about the unit vector `axis`. atan2 of the triple product
// keeps the sign that an acos of the normals would lose.
double SignedAngle(const Vector3d& from, const Vector3d& to, const Vector3d& axis) {
  return std::atan2(axis.dot(from.cross(to)), from.dot(to));
}

Vector3d AnyNormalOf(const Vector3d& tangent) {
  Eigen::Index smallest = 0;
  tangent.cwiseAbs().minCoeff(&smallest);
  return tangent.cross(Vector3d::Unit(smallest)).normalized();
}

// x along the straight, z along the bend's normal.
Eigen::Quaterniond TubeOrientation(const Vector3d& tangent, const Vector3d& normal) {
  Eigen::Matrix3d R_WT;
  R_WT.col(0) = tangent;
  R_WT.col(2) = (normal - normal.dot(tangent) * tangent).normalized();
  R_WT.col(1) = R_WT.col(2).cross(R_WT.col(0));
  return Eigen::Quaterniond(R_WT).normalized();
}

// Where a row's straight ends, and the frame of its bend there.
struct Station {
  Vector3d point_mm;
  Vector3d tangent;
  Vector3d normal;
};

// One station a row. Unlike the spine, this turns at sharp corners (bends without a radius) too.
std::vector<Station> Walk(const hal::Tube& tube) {
  std::vector<Station> stations;
  stations.reserve(tube.program.rows.size());
  Vector3d point = tube.X_WT.position_mm;
  Vector3d tangent = tube.X_WT.orientation * Vector3d::UnitX();
  Vector3d normal = tube.X_WT.orientation * Vector3d::UnitZ();
  for (const hal::BendRow& row : tube.program.rows) {
    normal = Eigen::AngleAxisd(row.rotation_deg * hal::kRadiansPerDegree, tangent) * normal;
    normal = (normal - normal.dot(tangent) * tangent).normalized();
    point += row.length_mm * tangent;
    stations.push_back({point, tangent, normal});
    const double phi = row.angle_deg * hal::kRadiansPerDegree;
    const Vector3d inward = normal.cross(tangent);
    point += row.bend_radius_mm.value_or(0.0) *
             (std::sin(phi) * tangent + (1.0 - std::cos(phi)) * inward);
    tangent = (std::cos(phi) * tangent + std::sin(phi) * inward).normalized();
  }
  return stations;
}

double ArcLength(const hal::BendRow& row) {
  return row.bend_radius_mm.value_or(0.0) * row.angle_deg * hal::kRadiansPerDegree;
}

// [0, 360)
double FullTurn(double rotation_deg) {
  const double turned = std::fmod(rotation_deg, 360.0);
  const double wrapped = turned < 0 ? turned + 360.0 : turned;
  return wrapped >= 360.0 ? 0.0 : wrapped;  // a tiny negative number plus 360 rounds to 360
}

bool NeedsRadius(const hal::BendRow& row) { return row.angle_deg != 0 && !row.bend_radius_mm; }

std::string RadiusMissing(std::size_t row) {
  return "row " + std::to_string(row + 1) +
         ": a feed along the spine includes the arcs, but this bend has no bend radius; give the "
         "bend radius (CLR) in mm";
}

auto BadPolygon(const std::string& message) {
  return hal::Fail(hal::ErrorKind::kBadInput, message);
}

// The way from each point of a control polygon to the next.
struct PolygonLegs {
  std::vector<Vector3d> tangents;
  std::vector<double> lengths_mm;
};

hal::Result<PolygonLegs> LegsOf(std::span<const Vector3d> points_mm) {
  PolygonLegs legs;
  for (std::size_t i = 0; i + 1 < points_mm.size(); ++i) {
    const Vector3d leg_mm = points_mm[i + 1] - points_mm[i];
    const double length_mm = leg_mm.norm();
    if (!std::isfinite(length_mm)) {
      return BadPolygon("point " + std::to_string(points_mm[i].allFinite() ? i + 2 : i + 1) +
                        " is not a finite number of millimetres");
    }
    if (length_mm <= 0) {
      return BadPolygon("points " + std::to_string(i + 1) + " and " + std::to_string(i + 2) +
                        " coincide; remove one of them");
    }
    legs.tangents.push_back(leg_mm / length_mm);
    legs.lengths_mm.push_back(length_mm);
  }
  return legs;
}

// What the bends leave of the legs. `setbacks_mm`: tangent length of each point.
hal::Result<void> SetStraights(std::span<const double> legs_mm, std::span<const double> setbacks_mm,
                               hal::BendProgram& program) {
  for (std::size_t i = 0; i < legs_mm.size(); ++i) {
    const double length_mm = legs_mm[i] - setbacks_mm[i] - setbacks_mm[i + 1];
    if (length_mm < -kRounding.overlap_mm) {
      return BadPolygon("points " + std::to_string(i + 1) + " and " + std::to_string(i + 2) +
                        " are " + Number(legs_mm[i]) + " mm apart, but the bends at them take " +
                        Number(setbacks_mm[i]) + " and " + Number(setbacks_mm[i + 1]) +
                        " mm of that; expected a straight of at least 0 mm between them, check the "
                        "bend radius");
    }
    program.rows[i].length_mm = std::max(0.0, length_mm);
  }
  return {};
}

}  // namespace

hal::BendProgram ReverseProgram(const hal::BendProgram& program) {
  const std::size_t bends = program.bend_count();
  hal::BendProgram reversed;
  reversed.rows.resize(program.rows.size());
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    hal::BendRow& row = reversed.rows[i];
    row.length_mm = program.rows[bends - i].length_mm;
    if (i == bends) break;
    row.angle_deg = program.rows[bends - 1 - i].angle_deg;
    row.bend_radius_mm = program.rows[bends - 1 - i].bend_radius_mm;
    // The rotation between two bends belongs to the later of them, which now is the other one.
    if (i > 0) row.rotation_deg = program.rows[bends - i].rotation_deg;
  }
  return reversed;
}

hal::Tube ReverseTube(const hal::Tube& tube) {
  hal::Tube reversed{tube.pipe_radius_mm, ReverseProgram(tube.program), tube.X_WT};
  const auto stations = Walk(tube);
  if (stations.empty()) return reversed;
  const Station& end = stations.back();
  const Station& last_bend = stations[stations.size() < 2 ? 0 : stations.size() - 2];
  reversed.X_WT.position_mm = end.point_mm;
  // Fed the other way round, the same bend turns about the opposite normal.
  reversed.X_WT.orientation = TubeOrientation(-end.tangent, -last_bend.normal);
  return reversed;
}

hal::Result<ControlPolygon> PolygonFromTube(const hal::Tube& tube) {
  const auto& rows = tube.program.rows;
  const auto stations = Walk(tube);
  if (stations.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the program has no rows; expected at least one length");
  }
  ControlPolygon polygon;
  polygon.points_mm.push_back(tube.X_WT.position_mm);
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    if (!(std::abs(rows[i].angle_deg) < 180.0)) {
      return hal::Fail(hal::ErrorKind::kBadInput,
                       "row " + std::to_string(i + 1) + ": a bend of " + Number(rows[i].angle_deg) +
                           " degrees has no intersection point; XYZ can express bends below 180 "
                           "degrees only, use LRA or pose");
    }
    const double setback_mm = rows[i].bend_radius_mm.value_or(0.0) *
                              std::tan(0.5 * rows[i].angle_deg * hal::kRadiansPerDegree);
    polygon.points_mm.push_back(stations[i].point_mm + setback_mm * stations[i].tangent);
    polygon.bend_radii_mm.push_back(rows[i].bend_radius_mm);
  }
  polygon.points_mm.push_back(stations.back().point_mm);
  return polygon;
}

hal::Result<hal::Tube> TubeFromPolygon(const ControlPolygon& polygon) {
  const auto& points = polygon.points_mm;
  const auto bad = [](const std::string& message) {
    return hal::Fail(hal::ErrorKind::kBadInput, message);
  };
  if (points.size() < 2) {
    return bad("a control polygon of " + std::to_string(points.size()) +
               " point(s); expected at least both ends of the tube");
  }
  const std::size_t bends = points.size() - 2;
  if (polygon.bend_radii_mm.size() != bends) {
    return bad(std::to_string(polygon.bend_radii_mm.size()) + " bend radii for " +
               std::to_string(bends) + " inner points; expected one for each");
  }
  const auto legs = LegsOf(points);
  if (!legs) return hal::Fail(legs.error());
  const auto& [tangents, legs_mm] = *legs;

  hal::Tube tube;
  tube.program.rows.resize(bends + 1);
  std::vector<double> setbacks_mm(bends + 2, 0.0);  // tangent length of each corner; 0 at the ends
  std::optional<Vector3d> normal;                   // of the bend before
  for (std::size_t i = 0; i < bends; ++i) {
    hal::BendRow& row = tube.program.rows[i];
    const Vector3d cross = tangents[i].cross(tangents[i + 1]);
    const double angle = std::atan2(cross.norm(), tangents[i].dot(tangents[i + 1]));
    row.bend_radius_mm = polygon.bend_radii_mm[i];
    if (row.bend_radius_mm && !(*row.bend_radius_mm > 0 && std::isfinite(*row.bend_radius_mm))) {
      return bad("point " + std::to_string(i + 2) + ": bend radius " + Number(*row.bend_radius_mm) +
                 " mm; expected a positive number of mm");
    }
    if (std::numbers::pi - angle < kRounding.collinear_rad) {
      return bad("point " + std::to_string(i + 2) +
                 ": the polygon turns back on itself (180 degrees); such a bend has no plane, use "
                 "LRA or pose");
    }
    if (angle < kRounding.collinear_rad)
      continue;  // a point on a straight: nothing to bend or rotate
    row.angle_deg = angle / hal::kRadiansPerDegree;
    setbacks_mm[i + 1] = row.bend_radius_mm.value_or(0.0) * std::tan(0.5 * angle);
    const Vector3d n = cross.normalized();
    if (normal) {
      row.rotation_deg =
          hal::WrapRotationDeg(SignedAngle(*normal, n, tangents[i]) / hal::kRadiansPerDegree);
    } else {
      tube.X_WT.orientation = TubeOrientation(tangents[0], n);
    }
    normal = n;
  }
  if (!normal) tube.X_WT.orientation = TubeOrientation(tangents[0], AnyNormalOf(tangents[0]));
  tube.X_WT.position_mm = points[0];

  const auto fitted = SetStraights(legs_mm, setbacks_mm, tube.program);
  if (!fitted) return hal::Fail(fitted.error());
  return tube;
}

hal::Result<std::vector<YbcRow>> YbcFromProgram(const hal::BendProgram& program,
                                                const YbcStyle& style) {
  std::vector<YbcRow> ybc;
  ybc.reserve(program.rows.size());
  double straights_mm = 0;
  double arcs_mm = 0;
  double turned_deg = 0;
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    const hal::BendRow& row = program.rows[i];
    if (style.feed == FeedCount::kAlongSpine && NeedsRadius(row)) {
      return hal::Fail(hal::ErrorKind::kBadInput, RadiusMissing(i));
    }
    straights_mm += row.length_mm;
    const double rotation_deg = style.rotation_sign * row.rotation_deg;
    turned_deg = FullTurn(turned_deg + rotation_deg);
    YbcRow out;
    out.y_mm = style.feed == FeedCount::kIncremental  ? row.length_mm
               : style.feed == FeedCount::kAlongSpine ? straights_mm + arcs_mm
                                                      : straights_mm;
    out.b_deg = style.rotation == RotationCount::kCumulative ? turned_deg
                                                             : hal::WrapRotationDeg(rotation_deg);
    out.c_deg = row.angle_deg;
    out.bend_radius_mm = row.bend_radius_mm;
    ybc.push_back(out);
    arcs_mm += ArcLength(row);
  }
  return ybc;
}

hal::Result<hal::BendProgram> ProgramFromYbc(const std::vector<YbcRow>& rows,
                                             const YbcStyle& style) {
  hal::BendProgram program;
  program.rows.reserve(rows.size());
  double fed_mm = 0;  // where the last bend ended, as the feed counts
  double turned_deg = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    hal::BendRow row{rows[i].y_mm, rows[i].b_deg, rows[i].c_deg, rows[i].bend_radius_mm};
    if (style.feed == FeedCount::kAlongSpine && NeedsRadius(row)) {
      return hal::Fail(hal::ErrorKind::kBadInput, RadiusMissing(i));
    }
    if (style.feed != FeedCount::kIncremental) {
      row.length_mm = rows[i].y_mm - fed_mm;
      if (row.length_mm < -kRounding.overlap_mm) {
        return hal::Fail(hal::ErrorKind::kBadInput,
                         "row " + std::to_string(i + 1) + ": feed " + Number(rows[i].y_mm) +
                             " mm lies before " + Number(fed_mm) +
                             " mm, where the bend before it ends; expected a feed that grows, or "
                             "incremental feeds");
      }
      row.length_mm = std::max(0.0, row.length_mm);
      fed_mm = std::max(fed_mm, rows[i].y_mm);
      if (style.feed == FeedCount::kAlongSpine) fed_mm += ArcLength(row);
    }
    if (style.rotation == RotationCount::kCumulative) {
      row.rotation_deg = rows[i].b_deg - turned_deg;
      turned_deg = rows[i].b_deg;
    }
    row.rotation_deg = hal::WrapRotationDeg(style.rotation_sign * row.rotation_deg);
    // After the last bend there is nothing to rotate for; machines repeat a value or write 0.
    if (i + 1 == rows.size() && row.angle_deg == 0) row.rotation_deg = 0;
    program.rows.push_back(row);
  }
  return program;
}

hal::Result<void> CheckProgram(const hal::BendProgram& program) {
  const auto bad = [](std::size_t row, const std::string& message) {
    return hal::Fail(hal::ErrorKind::kBadInput, "row " + std::to_string(row + 1) + ": " + message);
  };
  if (program.rows.empty()) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the program has no rows; expected at least one length");
  }
  for (std::size_t i = 0; i < program.rows.size(); ++i) {
    const hal::BendRow& row = program.rows[i];
    if (!std::isfinite(row.length_mm) || row.length_mm < 0) {
      return bad(i, "length " + Number(row.length_mm) + " mm; expected 0 or more");
    }
    if (!std::isfinite(row.rotation_deg)) {
      return bad(i, "rotation " + Number(row.rotation_deg) + "; expected degrees");
    }
    if (!(row.angle_deg >= 0 && row.angle_deg < 360)) {
      return bad(
          i, "angle " + Number(row.angle_deg) +
                 " degrees; expected 0 to less than 360 (a bend to the other side is a rotation of "
                 "180 degrees)");
    }
    if (row.bend_radius_mm && !(*row.bend_radius_mm > 0 && std::isfinite(*row.bend_radius_mm))) {
      return bad(i, "bend radius " + Number(*row.bend_radius_mm) + " mm; expected more than 0");
    }
    if (i + 1 == program.rows.size() && row.angle_deg != 0) {
      return bad(i, "the last row bends by " + Number(row.angle_deg) +
                        " degrees; expected a row with the end length and angle 0 after the last "
                        "bend");
    }
  }
  return {};
}

}  // namespace bendloop::pipeline
