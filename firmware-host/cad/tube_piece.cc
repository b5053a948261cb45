// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/tube_piece.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "firmware-host/cad/piece_rim.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
// Axes of one straight are parallel to this [rad]: 0.006 degrees, 0.1 mm a metre.
constexpr double kSameDirection = 1e-4;
// Faces of one straight with a gap of so many pipe radii between them: a groove, an O-ring.
constexpr double kWidestGapRadii = 4;
// The same along one bend [rad].
constexpr double kWidestGapAngle = 45 * std::numbers::pi / 180;

// A patch's part of a piece: where it begins along the piece, and how far it goes.
struct Part {
  double from = 0, to = 0;
  Around around;
  int face = 0;
  double off_mm = 0;
};

struct Group {
  TubePiece like;
  std::vector<Part> parts;
};

double LateralMm(const Vector3d& p, const TubePiece& line) {
  const Vector3d d = p - line.origin;
  return (d - d.dot(line.axis) * line.axis).norm();
}

bool SameSpine(const SurfacePatch& patch, const TubePiece& like) {
  const bool arc = patch.kind == PatchKind::kTorus;
  const double tolerance = MatchToleranceMm(like.radius_mm) / 2;
  if (arc != like.is_arc || std::abs(patch.radius_mm - like.radius_mm) > tolerance / 4)
    return false;
  if (arc) {
    return std::abs(patch.bend_radius_mm - like.bend_radius_mm) < tolerance &&
           (patch.origin - like.origin).norm() < tolerance &&
           patch.axis.cross(like.axis).norm() * like.bend_radius_mm < tolerance;
  }
  return patch.axis.cross(like.axis).norm() < kSameDirection &&
         LateralMm(patch.origin + patch.v0 * patch.axis, like) < tolerance &&
         LateralMm(patch.origin + patch.v1 * patch.axis, like) < tolerance;
}

int SectorOf(double angle) {
  const double turn = angle / (2 * std::numbers::pi);
  return std::clamp(int((turn - std::floor(turn)) * 72), 0, 71);
}

// Calls see(angle) in the patch's own count, in steps of less than a sector.
void EachAngle(double from, double to, const auto& see) {
  const int steps = std::max(1, int(std::ceil((to - from) * 180 / std::numbers::pi / 4)));
  for (int i = 0; i < steps; ++i) see(from + (to - from) * (i + 0.5) / steps);
}

Part PartOf(const SurfacePatch& patch, const TubePiece& like) {
  Part part;
  part.face = patch.face;
  part.off_mm = patch.off_mm;
  const Vector3d y = like.axis.cross(like.x);
  if (!like.is_arc) {
    const double a = (patch.origin + patch.v0 * patch.axis - like.origin).dot(like.axis);
    const double b = (patch.origin + patch.v1 * patch.axis - like.origin).dot(like.axis);
    std::tie(part.from, part.to) = std::minmax(a, b);
    EachAngle(patch.u0, patch.u1, [&](double u) {
      const Vector3d d = std::cos(u) * patch.x + std::sin(u) * patch.y;
      part.around.set(std::size_t(SectorOf(std::atan2(d.dot(y), d.dot(like.x)))));
    });
    return part;
  }
  const bool same_way = patch.x.cross(patch.y).dot(like.axis) > 0;
  const double start = same_way ? patch.u0 : patch.u1;
  const Vector3d d = std::cos(start) * patch.x + std::sin(start) * patch.y;
  part.from = std::atan2(d.dot(y), d.dot(like.x));
  part.to = part.from + (patch.u1 - patch.u0);
  const double up = patch.axis.dot(like.axis);
  EachAngle(patch.v0, patch.v1, [&](double v) {
    part.around.set(std::size_t(SectorOf(std::atan2(std::sin(v) * up, std::cos(v)))));
  });
  return part;
}

TubePiece Like(const SurfacePatch& patch) {
  TubePiece piece;
  piece.is_arc = patch.kind == PatchKind::kTorus;
  piece.origin = patch.origin;
  piece.axis = patch.axis.normalized();
  piece.x = piece.axis.unitOrthogonal();
  piece.bend_radius_mm = patch.bend_radius_mm;
  piece.radius_mm = patch.radius_mm;
  piece.concave = patch.concave;
  return piece;
}

// Turns the parts of a ring so that the widest gap between them lies at the count's end.
void Unwrap(std::vector<Part>& parts) {
  std::vector<std::pair<double, double>> spans;
  for (Part& p : parts) {
    const double turns = std::floor(p.from / (2 * std::numbers::pi)) * 2 * std::numbers::pi;
    p.from -= turns;
    p.to -= turns;
    spans.emplace_back(p.from, p.to);
  }
  std::sort(spans.begin(), spans.end());
  double reach = spans.front().second, widest = -1, start = spans.front().first;
  for (std::size_t i = 1; i <= spans.size(); ++i) {
    const double next =
        i < spans.size() ? spans[i].first : spans.front().first + 2 * std::numbers::pi;
    if (next - reach > widest) {
      widest = next - reach;
      start = i < spans.size() ? next : spans.front().first;
    }
    if (i < spans.size()) reach = std::max(reach, spans[i].second);
  }
  for (Part& p : parts) {
    if (p.from < start - 1e-9) {
      p.from += 2 * std::numbers::pi;
      p.to += 2 * std::numbers::pi;
    }
  }
}

void AddPiecesOf(Group& group, std::vector<TubePiece>& pieces) {
  if (group.like.is_arc) Unwrap(group.parts);
  std::sort(group.parts.begin(), group.parts.end(),
            [](const Part& a, const Part& b) { return a.from < b.from; });
  const double unit = group.like.is_arc ? group.like.bend_radius_mm : 1;
  const double most = group.like.is_arc ? kWidestGapAngle : kWidestGapRadii * group.like.radius_mm;
  std::optional<TubePiece> piece;
  for (const Part& part : group.parts) {
    if (piece && part.from - piece->to > most) {
      pieces.push_back(*piece);
      piece.reset();
    }
    if (!piece) {
      piece = group.like;
      piece->from = part.from;
      piece->to = part.to;
    }
    if (const double gap_mm = (part.from - piece->to) * unit; gap_mm > piece->widest_gap_mm) {
      piece->widest_gap_mm = gap_mm;
      piece->gap_from = piece->to;
    }
    piece->to = std::max(piece->to, part.to);
    piece->around |= part.around;
    piece->off_mm = std::max(piece->off_mm, part.off_mm);
    piece->faces.push_back(part.face);
  }
  if (piece) pieces.push_back(*piece);
}

}  // namespace

bool PointAtEachOther(const Vector3d& outward, const Vector3d& other) {
  return outward.dot(other) < 0 &&
         outward.cross(other).norm() < std::sin(kKinkDeg * std::numbers::pi / 180);
}

void AddAround(const std::vector<Vector3d>& points, const Vector3d& origin, const Vector3d& along,
               Around& around) {
  constexpr int kBetween = 8;  // places from one point to the next
  const Vector3d x = along.unitOrthogonal(), y = along.cross(x);
  const auto angle_of = [&](const Vector3d& p) {
    return std::atan2((p - origin).dot(y), (p - origin).dot(x));
  };
  const auto last = int(around.size()) - 1;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double a = angle_of(points[i]);
    const double step = std::remainder(angle_of(points[i + 1]) - a, 2 * std::numbers::pi);
    for (int k = 0; k <= kBetween; ++k) {
      const double turn = (a + step * k / kBetween) / (2 * std::numbers::pi);
      const double part = (turn - std::floor(turn)) * double(around.size());
      around.set(std::size_t(std::clamp(int(part), 0, last)));
    }
  }
}

Vector3d TubePiece::PointAt(double along) const {
  if (!is_arc) return origin + along * axis;
  return origin + bend_radius_mm * (std::cos(along) * x + std::sin(along) * axis.cross(x));
}

Vector3d TubePiece::TangentAt(double along) const {
  if (!is_arc) return axis;
  return std::cos(along) * axis.cross(x) - std::sin(along) * x;
}

bool TubePiece::HasOnSurface(const Vector3d& p, double tolerance_mm) const {
  const Vector3d d = p - origin;
  double along = d.dot(axis), across = (d - along * axis).norm(), unit = 1;
  if (is_arc) {
    across = std::hypot(across - bend_radius_mm, along);
    const double angle = std::atan2(d.dot(axis.cross(x)), d.dot(x));
    along = (from + to) / 2 + std::remainder(angle - (from + to) / 2, 2 * std::numbers::pi);
    unit = bend_radius_mm;
  }
  return std::abs(across - radius_mm) < tolerance_mm && (from - along) * unit < tolerance_mm &&
         (along - to) * unit < tolerance_mm;
}

bool TubePiece::is_ring() const {
  constexpr double kFullTurn = 2 * std::numbers::pi - 1e-3;
  return is_arc && to - from > kFullTurn;
}

double MatchToleranceMm(double radius_mm) { return 0.01 + 0.01 * radius_mm; }

std::vector<TubePiece> PiecesOf(const CadBody& body) {
  std::vector<Group> groups;
  for (const SurfacePatch& patch : body.patches) {
    if (patch.kind == PatchKind::kFree) continue;
    if (patch.kind == PatchKind::kTorus && patch.bend_radius_mm <= patch.radius_mm) continue;
    const auto found = std::find_if(groups.begin(), groups.end(), [&](const Group& g) {
      // Loose faces may point either way; those of a solid say which side the material is on.
      return (body.kind != BodyKind::kSolid || g.like.concave == patch.concave) &&
             SameSpine(patch, g.like);
    });
    Group& group = found != groups.end() ? *found : groups.emplace_back(Group{Like(patch), {}});
    if (body.kind != BodyKind::kSolid) group.like.concave = false;
    group.parts.push_back(PartOf(patch, group.like));
  }
  std::vector<TubePiece> pieces;
  for (Group& group : groups) AddPiecesOf(group, pieces);
  std::map<int, std::vector<const FaceEdge*>> edges;
  for (const FaceEdge& edge : body.edges) edges[edge.face].push_back(&edge);
  for (TubePiece& piece : pieces) {
    // A face may be in the piece by several patches.
    for (const int face : std::set<int>(piece.faces.begin(), piece.faces.end())) {
      piece.edges.insert(piece.edges.end(), edges[face].begin(), edges[face].end());
    }
    EndAtBorders(piece);
  }
  return pieces;
}

}  // namespace bendloop::host
