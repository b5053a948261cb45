// SPDX-License-Identifier: Apache-2.0
// The innermost loops of the fit.
#include "pipeline/fit/surface_sums.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "pipeline/math/product_sums.h"
#include "pipeline/math/simd.h"

namespace bendloop::pipeline {
namespace {

constexpr double kTiny = 1e-300;  // keeps a point on the axis from being divided by nothing

BENDLOOP_LOOP double Least(double a, double b) { return a < b ? a : b; }
BENDLOOP_LOOP double Most(double a, double b) { return a > b ? a : b; }

// 1 where the weight is full, 0 where there is none.
BENDLOOP_LOOP double Fade(double magnitude, double inverse_sigma) {
  const double fade = (kNoWeight - magnitude * inverse_sigma) * (1.0 / (kNoWeight - kFullWeight));
  return Least(Most(fade, 0.0), 1.0);
}
BENDLOOP_LOOP double Weight(double magnitude, double inverse_sigma) {
  const double fade = Fade(magnitude, inverse_sigma);
  return fade * fade * (3.0 - 2.0 * fade);
}
// The integral of 2 u weight(u): u^2 while the weight is full, constant where there is none.
BENDLOOP_LOOP double Robust(double magnitude, double inverse_sigma) {
  constexpr double kWidth = kNoWeight - kFullWeight;
  const double u = Least(magnitude * inverse_sigma, kFullWeight);
  const double f = Fade(magnitude, inverse_sigma);
  // Integral from f to 1 of 2 (5 - width f) (3 f^2 - 2 f^3) width df.
  const auto part = [](double g) {
    constexpr double kCube = kNoWeight, kFourth = -(2.0 * kNoWeight + 3.0 * kWidth) / 4.0;
    constexpr double kFifth = 2.0 * kWidth / 5.0;
    return g * g * g * (kCube + g * (kFourth + g * kFifth));
  };
  return u * u + 2.0 * kWidth * (part(1.0) - part(f));
}

struct Axes {
  explicit Axes(const SegmentFrame& f)
      : start{f.start_mm.x(), f.start_mm.y(), f.start_mm.z()},
        x{f.tangent.x(), f.tangent.y(), f.tangent.z()},
        y{f.across.x(), f.across.y(), f.across.z()},
        z{f.normal.x(), f.normal.y(), f.normal.z()} {}
  double start[3], x[3], y[3], z[3];
};

BENDLOOP_LOOP void ToLineBody(const SegmentFrame& frame, const PointLanes& points,
                              std::size_t count, LocalLanes& local) {
  const Axes a(frame);
  const double low = frame.low_mm, high = frame.high_mm;
  const double cut_low = frame.cut_low_mm, cut_high = frame.cut_high_mm;
  const double never = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < count; ++i) {
    const double vx = points.x[i] - a.start[0];
    const double vy = points.y[i] - a.start[1];
    const double vz = points.z[i] - a.start[2];
    const double x = vx * a.x[0] + vy * a.x[1] + vz * a.x[2];
    const double y = vx * a.y[0] + vy * a.y[1] + vz * a.y[2];
    const double z = vx * a.z[0] + vy * a.z[1] + vz * a.z[2];
    const double beyond = x - Least(Most(x, low), high);
    local.x[i] = x;
    local.y[i] = y;
    local.z[i] = z;
    const double distance = std::sqrt(beyond * beyond + y * y + z * z);
    local.distance[i] = x < cut_low || x > cut_high ? never : distance;
  }
}
BENDLOOP_MULTIVERSION(void, ToLine,
                      (const SegmentFrame& frame, const PointLanes& points, std::size_t count,
                       LocalLanes& local),
                      (frame, points, count, local))

BENDLOOP_LOOP void ToArcBody(const SegmentFrame& frame, const PointLanes& points, std::size_t count,
                             LocalLanes& local) {
  const Axes a(frame);
  const double radius = frame.bend_radius_mm, sine = frame.sine, cosine = frame.cosine;
  const bool long_way = frame.beyond_half_turn;
  for (std::size_t i = 0; i < count; ++i) {
    const double vx = points.x[i] - a.start[0];
    const double vy = points.y[i] - a.start[1];
    const double vz = points.z[i] - a.start[2];
    const double x = vx * a.x[0] + vy * a.x[1] + vz * a.x[2];
    const double y = vx * a.y[0] + vy * a.y[1] + vz * a.y[2] - radius;
    const double z = vx * a.z[0] + vy * a.z[1] + vz * a.z[2];
    const double u = std::sqrt(x * x + y * y) - radius;
    // Inside the sector: after the first plane and before the last, or either beyond a half turn.
    const double after_first = x;
    const double before_last = -(x * cosine + y * sine);
    const double inside =
        long_way ? Most(after_first, before_last) : Least(after_first, before_last);
    const double sx = x, sy = y + radius;
    const double ex = x - radius * sine, ey = y + radius * cosine;
    const double end2 = Least(sx * sx + sy * sy, ex * ex + ey * ey);
    const double across2 = inside >= 0 ? u * u : end2;
    local.x[i] = x;
    local.y[i] = y;
    local.z[i] = z;
    local.distance[i] = std::sqrt(across2 + z * z);
  }
}
BENDLOOP_MULTIVERSION(void, ToArc,
                      (const SegmentFrame& frame, const PointLanes& points, std::size_t count,
                       LocalLanes& local),
                      (frame, points, count, local))

// Up to kBatch points of a segment; those that are missing have no weight.
struct Batch {
  const double *x, *y, *z, *distance, *weight;
};
constexpr std::array<double, kBatch> kAlike = [] {
  std::array<double, kBatch> ones{};
  ones.fill(1.0);
  return ones;
}();

template <int kFunctions>
using Sums = ProductSums<kFunctions, kBatch>;

enum LineFunction { kOy, kOz, kXOy, kXOz, kLineOne, kLineDistance, kLineFunctions };

BENDLOOP_LOOP void AddLineBody(const Batch& p, double pipe_radius_mm, double inverse_sigma,
                               Sums<kLineFunctions>& sums) {
  auto& f = sums.functions;
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double distance = std::sqrt(p.y[l] * p.y[l] + p.z[l] * p.z[l]);
    const double inverse = 1.0 / Most(distance, kTiny);
    const double oy = p.y[l] * inverse;
    const double oz = p.z[l] * inverse;
    f[kOy][l] = oy;
    f[kOz][l] = oz;
    f[kXOy][l] = p.x[l] * oy;
    f[kXOz][l] = p.x[l] * oz;
    f[kLineOne][l] = 1.0;
    f[kLineDistance][l] = distance - pipe_radius_mm;
    sums.weight[l] = p.weight[l] * Weight(std::abs(p.distance[l]), inverse_sigma);
  }
  AddProducts(sums);
}
BENDLOOP_MULTIVERSION(void, AddLine,
                      (const Batch& p, double pipe_radius_mm, double inverse_sigma,
                       Sums<kLineFunctions>& sums),
                      (p, pipe_radius_mm, inverse_sigma, sums))

enum ArcFunction { kCa, kCb, kC, kSa, kSb, kS, kArcOne, kArcDistance, kArcFunctions };

BENDLOOP_LOOP void AddArcBody(const Batch& p, double bend_radius_mm, double pipe_radius_mm,
                              double inverse_sigma, Sums<kArcFunctions>& sums) {
  auto& f = sums.functions;
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double rho = std::sqrt(p.x[l] * p.x[l] + p.y[l] * p.y[l]);
    const double inverse_rho = 1.0 / Most(rho, kTiny);
    const double a = p.x[l] * inverse_rho;
    const double b = p.y[l] * inverse_rho;
    const double u = rho - bend_radius_mm;
    const double distance = std::sqrt(u * u + p.z[l] * p.z[l]);
    const double inverse = 1.0 / Most(distance, kTiny);
    const double c = u * inverse;
    const double s = p.z[l] * inverse;
    f[kCa][l] = c * a;
    f[kCb][l] = c * b;
    f[kC][l] = c;
    f[kSa][l] = s * a;
    f[kSb][l] = s * b;
    f[kS][l] = s;
    f[kArcOne][l] = 1.0;
    f[kArcDistance][l] = distance - pipe_radius_mm;
    sums.weight[l] = p.weight[l] * Weight(std::abs(p.distance[l]), inverse_sigma);
  }
  AddProducts(sums);
}
BENDLOOP_MULTIVERSION(void, AddArc,
                      (const Batch& p, double bend_radius_mm, double pipe_radius_mm,
                       double inverse_sigma, Sums<kArcFunctions>& sums),
                      (p, bend_radius_mm, pipe_radius_mm, inverse_sigma, sums))

// The rows are linear in few functions of the point; these are summed by `add`, batch after batch,
// and `rows_of` takes them to the rows.
template <int kFunctions, class Add>
CondensedSum SumThrough(const SegmentPoints& points,
                        const Eigen::Matrix<double, kCondensedRow, kFunctions>& rows_of, Add add) {
  Sums<kFunctions> sums;
  std::size_t first = 0;
  for (; first + kBatch <= points.size; first += kBatch) {
    add(Batch{points.x.data() + first, points.y.data() + first, points.z.data() + first,
              points.distance.data() + first,
              points.weighted ? points.weight.data() + first : kAlike.data()},
        sums);
  }
  if (const std::size_t left = points.size - first; left > 0) {
    LocalLanes rest;
    rest.x.fill(1.0);
    rest.y.fill(1.0);
    rest.z.fill(1.0);
    rest.distance.fill(std::numeric_limits<double>::max());
    const auto copy = [first, left](const SegmentPoints::Lane& from, auto& to) {
      std::copy_n(from.data() + first, left, to.begin());
    };
    copy(points.x, rest.x);
    copy(points.y, rest.y);
    copy(points.z, rest.z);
    copy(points.distance, rest.distance);
    std::array<double, kBatch> weight = kAlike;
    if (points.weighted) copy(points.weight, weight);
    add(Batch{rest.x.data(), rest.y.data(), rest.z.data(), rest.distance.data(), weight.data()},
        sums);
  }
  Eigen::Matrix<double, kFunctions, kFunctions> sum;
  for (int j = 0; j < kFunctions; ++j) {
    for (int i = j; i < kFunctions; ++i) sum(i, j) = sum(j, i) = sums.sum[i][j];
  }
  return rows_of * sum * rows_of.transpose();
}

// d = |(y, z)| - r, outward o = (0, oy, oz), torque x * (0, -oz, oy).
Eigen::Matrix<double, kCondensedRow, kLineFunctions> LineRows() {
  Eigen::Matrix<double, kCondensedRow, kLineFunctions> rows_of =
      Eigen::Matrix<double, kCondensedRow, kLineFunctions>::Zero();
  rows_of(1, kOy) = -1;
  rows_of(2, kOz) = -1;
  rows_of(4, kXOz) = 1;
  rows_of(5, kXOy) = -1;
  rows_of(7, kLineOne) = -1;
  rows_of(kLocalState, kLineDistance) = 1;
  return rows_of;
}

CondensedSum SumOfLine(const SegmentPoints& points, double pipe_radius_mm, double inverse_sigma) {
  const auto rows_of = LineRows();
  return SumThrough<kLineFunctions>(points, rows_of, [&](const Batch& batch, auto& sums) {
    AddLine(batch, pipe_radius_mm, inverse_sigma, sums);
  });
}

// In the plane of the bend (a, b) is the unit vector from the centre, u the distance beyond the
// spine's circle; (c, s) = (u, z) / |(u, z)|. Outward is (c a, c b, s), the torque about the start
// R (s + s b, -s a, -c a). Moving the centre by dR along +y changes u by -b dR - dR.
Eigen::Matrix<double, kCondensedRow, kArcFunctions> ArcRows(double bend_radius_mm) {
  Eigen::Matrix<double, kCondensedRow, kArcFunctions> rows_of =
      Eigen::Matrix<double, kCondensedRow, kArcFunctions>::Zero();
  rows_of(0, kCa) = -1;
  rows_of(1, kCb) = -1;
  rows_of(2, kS) = -1;
  rows_of(3, kS) = rows_of(3, kSb) = -bend_radius_mm;
  rows_of(4, kSa) = bend_radius_mm;
  rows_of(5, kCa) = bend_radius_mm;
  rows_of(6, kCb) = rows_of(6, kC) = -1;
  rows_of(7, kArcOne) = -1;
  rows_of(kLocalState, kArcDistance) = 1;
  return rows_of;
}

CondensedSum SumOfArc(const SegmentPoints& points, double bend_radius_mm, double pipe_radius_mm,
                      double inverse_sigma) {
  const auto rows_of = ArcRows(bend_radius_mm);
  return SumThrough<kArcFunctions>(points, rows_of, [&](const Batch& batch, auto& sums) {
    AddArc(batch, bend_radius_mm, pipe_radius_mm, inverse_sigma, sums);
  });
}

// The oval arc: as above, and the functions of Flattening. The surface lies inside the round one.
enum OvalFunction {
  kQuadrant = kArcDistance + 1,
  kBumpQuadrant,
  kBumpOuter,
  kPlateauOuter,
  kOvalFunctions
};

// Of a line's section.
enum OvalLineFunction {
  kQuadrantBefore = kLineDistance + 1,
  kOuterBefore,
  kQuadrantBehind,
  kOuterBehind,
  kOvalLineFunctions
};

struct OvalBend {
  OvalBend(const SegmentFrame& frame, double r_mm)
      : bend_radius_mm(frame.bend_radius_mm),
        pipe_radius_mm(r_mm),
        half_sine(frame.half_sine),
        half_cosine(frame.half_cosine),
        bump_floor(frame.bump_floor),
        bump_scale(frame.bump_scale),
        constant(0.5 * r_mm * frame.flattening->constant),
        bump(0.5 * r_mm * frame.flattening->bump),
        collapse(r_mm * frame.flattening->collapse),
        plateau(r_mm * frame.flattening->plateau),
        wide(frame.flattening->is_wide && frame.flattening->rise.is_none() ? 1.0 : 0.0),
        rises(frame.flattening->rise.is_none() ? 0.0 : 1.0),
        share(frame.share),
        sine(frame.sine),
        cosine(frame.cosine),
        before(rises > 0 ? frame.since_risen_mm / frame.flattening->rise.half_mm : 0.0),
        behind(rises > 0 ? frame.until_fallen_mm / frame.flattening->rise.half_mm : 0.0),
        per_half_turn(rises > 0 ? 2.0 * frame.bend_radius_mm / frame.flattening->rise.half_mm
                                : 0.0) {}
  double bend_radius_mm, pipe_radius_mm, half_sine, half_cosine, bump_floor, bump_scale;
  double constant, bump, collapse, plateau;  // [mm]
  double wide, rises;                        // 1 or 0
  double share;
  double sine, cosine;                   // of the arc's angle
  double before, behind, per_half_turn;  // [rises]
};

// B at a place around the centre of the bend.
BENDLOOP_LOOP double Bump(const OvalBend& oval, double a, double b) {
  return Most(0.0, (a * oval.half_sine - b * oval.half_cosine - oval.bump_floor) * oval.bump_scale);
}
BENDLOOP_LOOP double Square(double x) { return x * x; }
BENDLOOP_LOOP double Plateau(double bump) { return 1.0 - Square(Square(1.0 - bump)); }
// Of an angle up to a quarter turn, to 1e-5; of a wider one, up to three quarters, that quarter.
// Arc tangent: Abramowitz & Stegun, 4.4.47.
BENDLOOP_LOOP double HalfAngleOf(double sine, double cosine) {
  const double u = Least(Most(sine / Most(1.0 + cosine, 1e-9), -1.0), 1.0);
  const double u2 = u * u;
  return u *
         (0.9998660 + u2 * (-0.3302995 + u2 * (0.1801410 + u2 * (-0.0851330 + u2 * 0.0208351))));
}
// How far the section has risen at a place around the centre of the bend.
BENDLOOP_LOOP double RisenAt(const OvalBend& oval, double a, double b) {
  const double to_end_sine = -oval.sine * b - oval.cosine * a;
  const double to_end_cosine = oval.sine * a - oval.cosine * b;
  const double from_start = oval.before + oval.per_half_turn * HalfAngleOf(a, -b);
  const double to_end = oval.behind + oval.per_half_turn * HalfAngleOf(to_end_sine, to_end_cosine);
  // No section rises further into a bend than a quarter turn (section_rise.cc).
  const double begun = b > 0 ? 1.0 : Risen(from_start);
  const double not_ended = to_end_cosine < 0 ? 1.0 : Risen(to_end);
  return oval.share + oval.rises * (Most(begun + not_ended - 1.0, 0.0) - oval.share);
}
// Parts of a collapse and of a plateau, of the square of the outer side's cosine.
struct SunkAt {
  double collapse, plateau;
};
BENDLOOP_LOOP SunkAt SinksAt(const OvalBend& oval, double bump, double risen, double outer) {
  const double inside = Plateau(bump);
  const double plateau = inside + oval.rises * (risen - inside);
  return {bump + oval.rises * (risen - bump), plateau * Most(outer, oval.wide)};
}

BENDLOOP_LOOP void AddOvalArcBody(const Batch& p, const OvalBend& oval, double inverse_sigma,
                                  Sums<kOvalFunctions>& sums) {
  auto& f = sums.functions;
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double rho = std::sqrt(p.x[l] * p.x[l] + p.y[l] * p.y[l]);
    const double inverse_rho = 1.0 / Most(rho, kTiny);
    const double a = p.x[l] * inverse_rho;
    const double b = p.y[l] * inverse_rho;
    const double u = rho - oval.bend_radius_mm;
    const double distance = std::sqrt(u * u + p.z[l] * p.z[l]);
    const double inverse = 1.0 / Most(distance, kTiny);
    const double c = u * inverse;
    const double s = p.z[l] * inverse;
    const double quadrant = c * c - s * s;
    const double bump = Bump(oval, a, b), risen = RisenAt(oval, a, b);
    const double outer = Square(Most(c, 0.0));
    const SunkAt sinks = SinksAt(oval, bump, risen, outer);
    f[kCa][l] = c * a;
    f[kCb][l] = c * b;
    f[kC][l] = c;
    f[kSa][l] = s * a;
    f[kSb][l] = s * b;
    f[kS][l] = s;
    f[kArcOne][l] = 1.0;
    f[kQuadrant][l] = risen * quadrant;
    f[kBumpQuadrant][l] = bump * quadrant;
    f[kBumpOuter][l] = sinks.collapse * outer;
    f[kPlateauOuter][l] = sinks.plateau * outer;
    f[kArcDistance][l] = distance - oval.pipe_radius_mm + oval.constant * risen * quadrant +
                         oval.bump * bump * quadrant +
                         (oval.collapse * sinks.collapse + oval.plateau * sinks.plateau) * outer;
    sums.weight[l] = p.weight[l] * Weight(std::abs(p.distance[l]), inverse_sigma);
  }
  AddProducts(sums);
}
BENDLOOP_MULTIVERSION(void, AddOvalArc,
                      (const Batch& p, const OvalBend& oval, double inverse_sigma,
                       Sums<kOvalFunctions>& sums),
                      (p, oval, inverse_sigma, sums))

BENDLOOP_LOOP void InsideOfBody(const OvalBend& oval, const LocalLanes& local, double* inside) {
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double rho = std::sqrt(local.x[l] * local.x[l] + local.y[l] * local.y[l]);
    const double inverse_rho = 1.0 / Most(rho, kTiny);
    const double u2 = Square(rho - oval.bend_radius_mm);
    const double z2 = local.z[l] * local.z[l];
    const double inverse = 1.0 / Most(u2 + z2, kTiny);
    const double a = local.x[l] * inverse_rho, b = local.y[l] * inverse_rho;
    const double bump = Bump(oval, a, b), risen = RisenAt(oval, a, b);
    const double outer = rho > oval.bend_radius_mm ? u2 * inverse : 0.0;
    const SunkAt sinks = SinksAt(oval, bump, risen, outer);
    inside[l] = (oval.constant * risen + oval.bump * bump) * (u2 - z2) * inverse +
                (oval.collapse * sinks.collapse + oval.plateau * sinks.plateau) * outer;
  }
}
BENDLOOP_MULTIVERSION(void, InsideOf,
                      (const OvalBend& oval, const LocalLanes& local, double* inside),
                      (oval, local, inside))

CondensedSum SumOfOvalArc(const SegmentPoints& points, const SegmentFrame& frame,
                          double pipe_radius_mm, double inverse_sigma) {
  Eigen::Matrix<double, kCondensedRow, kOvalFunctions> rows_of =
      Eigen::Matrix<double, kCondensedRow, kOvalFunctions>::Zero();
  rows_of.leftCols<kArcFunctions>() = ArcRows(frame.bend_radius_mm);
  rows_of(kFlatteningState, kQuadrant) = 0.5 * pipe_radius_mm;
  rows_of(kFlatteningState + 1, kBumpQuadrant) = 0.5 * pipe_radius_mm;
  rows_of(kFlatteningState + 2, kBumpOuter) = pipe_radius_mm;
  rows_of(kFlatteningState + 3, kPlateauOuter) = pipe_radius_mm;
  const OvalBend oval(frame, pipe_radius_mm);
  return SumThrough<kOvalFunctions>(points, rows_of, [&](const Batch& batch, auto& sums) {
    AddOvalArc(batch, oval, inverse_sigma, sums);
  });
}

// A line's section: what the bends beyond its ends make of it.
struct OvalLine {
  struct Side {
    Side(const SectionBeside& of, double r_mm)
        : half_risen_mm(of.half_risen_mm),
          half_fallen_mm(of.half_fallen_mm),
          per_mm(of.towards != 0 ? of.towards / of.of_bend.rise.half_mm : 0.0),
          is_there(of.towards != 0 ? 1.0 : 0.0),
          out_y(of.out_y),
          out_z(of.out_z),
          constant(0.5 * r_mm * of.of_bend.constant),
          collapse(r_mm * of.of_bend.collapse),
          plateau(r_mm * of.of_bend.plateau) {}
    double half_risen_mm, half_fallen_mm, per_mm, is_there, out_y, out_z;
    double constant, collapse, plateau;  // [mm]
  };
  OvalLine(const SegmentFrame& frame, double r_mm)
      : sides{Side(frame.beside[0], r_mm), Side(frame.beside[1], r_mm)} {}
  std::array<Side, 2> sides;
};
struct OvalAt {
  double quadrant, outer, inside_mm;
};
BENDLOOP_LOOP OvalAt SectionAt(const OvalLine::Side& side, double x, double oy, double oz) {
  const double c = oy * side.out_y + oz * side.out_z;
  const double outer = Square(Most(c, 0.0));
  const double begun = Risen((x - side.half_risen_mm) * side.per_mm);
  const double not_ended = Risen((side.half_fallen_mm - x) * side.per_mm);
  const double risen = side.is_there * Most(begun + not_ended - 1.0, 0.0);
  const double quadrant = 2.0 * c * c - 1.0;
  return {risen * quadrant, 0.5 * risen * (outer + outer * outer),
          risen * (side.constant * quadrant + (side.collapse + side.plateau * outer) * outer)};
}
BENDLOOP_LOOP double InsideOfLine(const OvalLine& oval, double x, double y, double z) {
  const double inverse = 1.0 / Most(std::sqrt(y * y + z * z), kTiny);
  double inside_mm = 0;
  for (const OvalLine::Side& side : oval.sides) {
    inside_mm += SectionAt(side, x, y * inverse, z * inverse).inside_mm;
  }
  return inside_mm;
}

BENDLOOP_LOOP void AddOvalLineBody(const Batch& p, double pipe_radius_mm, const OvalLine& oval,
                                   double inverse_sigma, Sums<kOvalLineFunctions>& sums) {
  auto& f = sums.functions;
  for (std::size_t l = 0; l < kBatch; ++l) {
    const double distance = std::sqrt(p.y[l] * p.y[l] + p.z[l] * p.z[l]);
    const double inverse = 1.0 / Most(distance, kTiny);
    const double oy = p.y[l] * inverse;
    const double oz = p.z[l] * inverse;
    const OvalAt before = SectionAt(oval.sides[0], p.x[l], oy, oz);
    const OvalAt behind = SectionAt(oval.sides[1], p.x[l], oy, oz);
    f[kOy][l] = oy;
    f[kOz][l] = oz;
    f[kXOy][l] = p.x[l] * oy;
    f[kXOz][l] = p.x[l] * oz;
    f[kLineOne][l] = 1.0;
    f[kQuadrantBefore][l] = before.quadrant;
    f[kOuterBefore][l] = before.outer;
    f[kQuadrantBehind][l] = behind.quadrant;
    f[kOuterBehind][l] = behind.outer;
    f[kLineDistance][l] = distance - pipe_radius_mm + before.inside_mm + behind.inside_mm;
    sums.weight[l] = p.weight[l] * Weight(std::abs(p.distance[l]), inverse_sigma);
  }
  AddProducts(sums);
}
BENDLOOP_MULTIVERSION(void, AddOvalLine,
                      (const Batch& p, double pipe_radius_mm, const OvalLine& oval,
                       double inverse_sigma, Sums<kOvalLineFunctions>& sums),
                      (p, pipe_radius_mm, oval, inverse_sigma, sums))

BENDLOOP_LOOP void InsideOfLinesBody(const OvalLine& oval, const LocalLanes& local,
                                     double* inside) {
  for (std::size_t l = 0; l < kBatch; ++l) {
    inside[l] = InsideOfLine(oval, local.x[l], local.y[l], local.z[l]);
  }
}
BENDLOOP_MULTIVERSION(void, InsideOfLines,
                      (const OvalLine& oval, const LocalLanes& local, double* inside),
                      (oval, local, inside))

CondensedSum SumOfOvalLine(const SegmentPoints& points, const SegmentFrame& frame,
                           double pipe_radius_mm, double inverse_sigma) {
  Eigen::Matrix<double, kCondensedRow, kOvalLineFunctions> rows_of =
      Eigen::Matrix<double, kCondensedRow, kOvalLineFunctions>::Zero();
  rows_of.leftCols<kLineFunctions>() = LineRows();
  for (const int side : {0, 2}) {
    rows_of(kFlatteningState + side, kQuadrantBefore + side) = 0.5 * pipe_radius_mm;
    rows_of(kFlatteningState + side + 1, kOuterBefore + side) = pipe_radius_mm;
  }
  const OvalLine oval(frame, pipe_radius_mm);
  return SumThrough<kOvalLineFunctions>(points, rows_of, [&](const Batch& batch, auto& sums) {
    AddOvalLine(batch, pipe_radius_mm, oval, inverse_sigma, sums);
  });
}

BENDLOOP_LOOP double RobustSumOfBody(const double* distances_mm, std::size_t count,
                                     double inverse_sigma) {
  double sum = 0;
#pragma omp simd reduction(+ : sum)
  for (std::size_t i = 0; i < count; ++i) sum += Robust(std::abs(distances_mm[i]), inverse_sigma);
  return sum;
}
BENDLOOP_MULTIVERSION(double, RobustSumOf,
                      (const double* distances_mm, std::size_t count, double inverse_sigma),
                      (distances_mm, count, inverse_sigma))

}  // namespace

void ToSegment(const SegmentFrame& frame, const PointLanes& points, std::size_t count,
               LocalLanes& local) {
  // Whole registers; what lies beyond `count` is calculated and not looked at.
  const std::size_t rounded = std::min((count + 3) / 4 * 4, kBatch);
  if (frame.bend_radius_mm > 0) {
    ToArc(frame, points, rounded, local);
  } else {
    ToLine(frame, points, rounded, local);
  }
}

void FlattenedBy(const SegmentFrame& frame, double pipe_radius_mm, const LocalLanes& local,
                 std::array<double, kBatch>& inside_mm) {
  if (frame.flattening) {
    InsideOf(OvalBend(frame, pipe_radius_mm), local, inside_mm.data());
  } else {
    InsideOfLines(OvalLine(frame, pipe_radius_mm), local, inside_mm.data());
  }
}

double FlattenedBy(const SegmentFrame& line, double pipe_radius_mm, double x, double y, double z) {
  return InsideOfLine(OvalLine(line, pipe_radius_mm), x, y, z);
}

void SegmentPoints::MakeRoom(std::size_t more) {
  const auto needed = static_cast<Eigen::Index>(size + more);
  if (needed > x.size()) {
    const Eigen::Index room = std::max(2 * x.size(), needed);
    for (Lane* lane : {&x, &y, &z, &distance}) lane->conservativeResize(room);
  }
  if (weighted && weight.size() < x.size()) weight.conservativeResize(x.size());
}

void SegmentPoints::AddFirst(const LocalLanes& from, std::size_t count,
                             const std::array<double, kBatch>& from_surface_mm) {
  const auto append = [this, count](const std::array<double, kBatch>& lane, Lane& to) {
    std::copy_n(lane.data(), count, to.data() + size);
  };
  append(from.x, x);
  append(from.y, y);
  append(from.z, z);
  append(from_surface_mm, distance);
  size += count;
}

CondensedSum SumOfRows(const SegmentPoints& points, const SegmentFrame& frame,
                       double pipe_radius_mm, double sigma_mm) {
  if (frame.flattening) return SumOfOvalArc(points, frame, pipe_radius_mm, 1.0 / sigma_mm);
  if (frame.is_flattened()) return SumOfOvalLine(points, frame, pipe_radius_mm, 1.0 / sigma_mm);
  return frame.bend_radius_mm > 0
             ? SumOfArc(points, frame.bend_radius_mm, pipe_radius_mm, 1.0 / sigma_mm)
             : SumOfLine(points, pipe_radius_mm, 1.0 / sigma_mm);
}

double RobustSum(std::span<const double> distances_mm, double sigma_mm) {
  return RobustSumOf(distances_mm.data(), distances_mm.size(), 1.0 / sigma_mm);
}

double RobustSum(double distance_mm, double sigma_mm) {
  return Robust(std::abs(distance_mm), 1.0 / sigma_mm);
}

double RobustWeight(double distance_mm, double sigma_mm) {
  return Weight(std::abs(distance_mm), 1.0 / sigma_mm);
}

}  // namespace bendloop::pipeline
