// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <vector>

#include "firmware-host/cad/cad_shape.h"

namespace bendloop::host {

// A piece with less around it [deg] is a fillet or an edge's rounding; half a bend is a bend.
inline constexpr double kFewestAroundDeg = 150;
// Neighbours that meet at more than this [deg] are a kink; less is a drawing's rounding, and told.
inline constexpr double kKinkDeg = 0.5;
// Pieces are one tube's, though they lie up to so many pipe radii beside each other, as faces do
// that were joined with a tolerance; and bodies so many before or into each other.
inline constexpr double kBesideRadii = 0.1, kApartRadii = 1;

// Whether two ends, by their ways out, are no kink where they meet.
bool PointAtEachOther(const Eigen::Vector3d& outward, const Eigen::Vector3d& other);

// Sectors of 5 degrees around a tube.
using Around = std::bitset<72>;

// Adds those that a line of points goes through, about an axis through `origin` along `along`.
void AddAround(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& along, Around& around);

// The faces of one straight or one bend: all that lie on the same cylinder or torus and touch, be
// they halves, quarters, or pieces of a B-spline. CAD systems cut them each in its own way.
struct TubePiece {
  bool is_arc = false;
  Eigen::Vector3d origin;  // on the line, or the arc's centre
  Eigen::Vector3d axis;    // of the line, or the arc's normal
  Eigen::Vector3d x;       // across the line, or where an arc's angle is 0
  double bend_radius_mm = 0;
  double from = 0, to = 0;  // mm along the line, radians along the arc, growing
  double radius_mm = 0;     // of the surface about the line or arc
  bool concave = false;     // the material is outside: a tube's inner surface
  Around around;            // which sectors have a face somewhere along it
  std::vector<int> faces;
  std::vector<const FaceEdge*> edges;  // of its faces; of the body, which outlives it
  double widest_gap_mm = 0;            // between its faces, along it
  double gap_from = 0;                 // where that begins, as `from`
  double off_mm = 0;                   // its B-splines lie so far off it, at most
  bool inferred = false;               // no face shows it: it follows from its neighbours

  Eigen::Vector3d PointAt(double along) const;
  Eigen::Vector3d TangentAt(double along) const;  // unit, the way that `along` grows
  double length_mm() const { return (to - from) * (is_arc ? bend_radius_mm : 1); }
  // Whether `p` lies on its surface, between its ends.
  bool HasOnSurface(const Eigen::Vector3d& p, double tolerance_mm) const;
  bool is_ring() const;  // an arc of a whole turn: a ring, a bead or a fillet, and no bend
  double around_deg() const { return 5.0 * double(around.count()); }
};

// How far axes of one tube may lie apart in a file [mm]: rounded coordinates, and drawings whose
// pieces nearly meet. A hundredth of the pipe radius is below what a scanner or a bender holds.
double MatchToleranceMm(double radius_mm);

// Straights and bends of all surfaces of a body, tube or not; patches are recognised already.
std::vector<TubePiece> PiecesOf(const CadBody& body);

}  // namespace bendloop::host
