// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/near_surface.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "firmware-host/cad/free_surface.h"

namespace bendloop::host {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

// A fit takes at most so many samples; what it says holds for all of them.
constexpr std::size_t kMostFitted = 1500;
constexpr std::size_t kFewestFitted = 12;
constexpr int kMostIterations = 12;
// A run of pieces goes on while its deviation grows by no more than this: where a bend begins, it
// grows at once.
constexpr double kMostGrowth = 2.5;
// Below this [mm] growth says nothing: files have so many decimals.
constexpr double kSteadyMm = 2e-4;

// So many times nearer, a torus is preferred to a cylinder.
constexpr double kMuchNearer = 3;

std::vector<Vector3d> Thinned(const SurfacePatch& patch) {
  std::vector<Vector3d> points;
  const std::size_t step = 1 + patch.samples.size() / kMostFitted;
  for (std::size_t i = 0; i < patch.samples.size(); i += step) {
    points.push_back(patch.samples[i].point);
  }
  return points;
}

// Least squares by Gauss and Newton, numeric derivatives; all of `x` about 1.
void Refine(VectorXd& x, const std::size_t count, const auto& residual) {
  constexpr double kStep = 1e-6;
  Eigen::MatrixXd slope(Eigen::Index(count), x.size());
  VectorXd value(Eigen::Index(count), 1);
  for (int k = 0; k < kMostIterations; ++k) {
    for (std::size_t i = 0; i < count; ++i) value(Eigen::Index(i)) = residual(x, i);
    for (Eigen::Index j = 0; j < x.size(); ++j) {
      VectorXd up = x, down = x;
      up(j) += kStep;
      down(j) -= kStep;
      for (std::size_t i = 0; i < count; ++i) {
        slope(Eigen::Index(i), j) = (residual(up, i) - residual(down, i)) / (2 * kStep);
      }
    }
    const Eigen::MatrixXd normal = slope.transpose() * slope;
    const VectorXd step = normal.ldlt().solve(slope.transpose() * value);
    if (!step.allFinite()) return;
    x -= step;
    if (step.norm() < 1e-12) return;
  }
}

// A frame in which a patch is about 1 large, for its fit.
struct Scaled {
  std::vector<Vector3d> points;
  Vector3d mean, axis, x, y;
  double size_mm;

  Scaled(const SurfacePatch& patch, const SurfaceGuess& guess, const Vector3d& along)
      : points(Thinned(patch)),
        mean(guess.mean),
        axis(along),
        x(along.unitOrthogonal()),
        y(along.cross(x)),
        size_mm(guess.size_mm) {
    for (Vector3d& p : points) p = (p - mean) / size_mm;
  }
  Vector3d Tilted(double a, double b) const { return (axis + a * x + b * y).normalized(); }
};

bool TryCylinder(SurfacePatch& patch, const SurfaceGuess& guess) {
  const Scaled s(patch, guess, guess.cylinder_axis);
  double radius = 0;
  for (const Vector3d& p : s.points) {
    radius += (p - p.dot(s.axis) * s.axis).norm() / double(s.points.size());
  }
  VectorXd v = VectorXd::Zero(5);  // tilts, offsets, radius
  v(4) = radius;
  Refine(v, s.points.size(), [&](const VectorXd& p, std::size_t i) {
    const Vector3d axis = s.Tilted(p(0), p(1));
    const Vector3d d = s.points[i] - p(2) * s.x - p(3) * s.y;
    return (d - d.dot(axis) * axis).norm() - p(4);
  });
  return BecomeCylinder(patch, s.Tilted(v(0), v(1)), guess.mean, NearSurfaceMm);
}

bool TryTorus(SurfacePatch& patch, const SurfaceGuess& guess) {
  if (!guess.has_revolution) return false;
  const Scaled s(patch, guess, guess.revolution_axis);
  const Vector3d at = (guess.on_revolution_axis - guess.mean) / guess.size_mm;
  // Starts with the profile's middle as the spine.
  double bend = 0, height = 0;
  for (const Vector3d& p : s.points) {
    const Vector3d d = p - at;
    height += d.dot(s.axis) / double(s.points.size());
    bend += (d - d.dot(s.axis) * s.axis).norm() / double(s.points.size());
  }
  VectorXd v(7);  // tilts, centre, bend radius, pipe radius
  const Vector3d centre = at + height * s.axis;
  double radius = 0;
  for (const Vector3d& p : s.points) {
    const Vector3d d = p - centre;
    const double h = d.dot(s.axis);
    radius += std::hypot((d - h * s.axis).norm() - bend, h) / double(s.points.size());
  }
  v << 0, 0, centre, bend, radius;
  Refine(v, s.points.size(), [&](const VectorXd& p, std::size_t i) {
    const Vector3d axis = s.Tilted(p(0), p(1)), d = s.points[i] - Vector3d(p.segment<3>(2));
    const double h = d.dot(axis);
    return std::hypot((d - h * axis).norm() - p(5), h) - p(6);
  });
  return BecomeTorus(patch, s.Tilted(v(0), v(1)),
                     guess.mean + guess.size_mm * Vector3d(v.segment<3>(2)), NearSurfaceMm);
}

using Cells = std::vector<const SurfacePatch*>;

// One cylinder or torus near all samples of the cells.
std::optional<SurfacePatch> NearSurface(const Cells& cells) {
  SurfacePatch all = *cells.front();
  all.kind = PatchKind::kFree;
  for (std::size_t i = 1; i < cells.size(); ++i) {
    all.samples.insert(all.samples.end(), cells[i]->samples.begin(), cells[i]->samples.end());
  }
  if (all.samples.size() < kFewestFitted) return std::nullopt;
  const SurfaceGuess guess = GuessSurface(all);
  if (guess.is_plane) return std::nullopt;
  SurfacePatch torus = all;
  const bool is_cylinder = TryCylinder(all, guess);
  // A short piece of a bend is near to a cylinder, too.
  if (is_cylinder && all.off_mm < kSteadyMm) return all;
  if (!TryTorus(torus, guess)) return is_cylinder ? std::optional(std::move(all)) : std::nullopt;
  return is_cylinder && torus.off_mm * kMuchNearer > all.off_mm ? all : torus;
}

// The cells of a face in strips, cut along one of the surface's parameters, one after the other.
std::vector<Cells> Strips(const Cells& cells, bool along_u) {
  std::map<int, Cells> strips;
  for (const SurfacePatch* cell : cells) {
    strips[along_u ? cell->cell_u : cell->cell_v].push_back(cell);
  }
  std::vector<Cells> all;
  for (auto& [number, strip] : strips) all.push_back(std::move(strip));
  return all;
}

// Strips as far as each cylinder or torus goes; nothing where one is neither.
std::optional<std::vector<SurfacePatch>> Runs(const std::vector<Cells>& strips) {
  std::vector<SurfacePatch> runs;
  for (std::size_t i = 0; i < strips.size();) {
    Cells cells = strips[i];
    auto run = NearSurface(cells);
    if (!run) return std::nullopt;
    for (++i; i < strips.size(); ++i) {
      Cells longer = cells;
      longer.insert(longer.end(), strips[i].begin(), strips[i].end());
      auto next = NearSurface(longer);
      if (!next || next->kind != run->kind ||
          next->off_mm > std::max(kSteadyMm, kMostGrowth * run->off_mm)) {
        break;
      }
      cells = std::move(longer);
      run = std::move(next);
    }
    runs.push_back(std::move(*run));
  }
  return runs;
}

double SizeMm(const SurfacePatch& patch) {
  double size = 0;
  for (const OrientedPoint& s : patch.samples) {
    size = std::max(size, (s.point - patch.samples.front().point).norm());
  }
  return size;
}

// Whether all samples of `cell` lie about where `whole` goes: what has thousands of pieces is
// sorted by this.
bool LiesNear(const SurfacePatch& whole, const SurfacePatch& cell) {
  constexpr double kNear = 10 * kExactSurfaceMm;
  return std::all_of(cell.samples.begin(), cell.samples.end(), [&](const OrientedPoint& s) {
    const Vector3d d = s.point - whole.origin;
    const double height = d.dot(whole.axis), across = (d - height * whole.axis).norm();
    const double off = whole.kind == PatchKind::kTorus
                           ? std::hypot(across - whole.bend_radius_mm, height) - whole.radius_mm
                           : across - whole.radius_mm;
    return std::abs(off) < kNear;
  });
}

// `cell` as a part of the cylinder or torus of `whole`; nothing where it does not lie on it.
std::optional<SurfacePatch> AsPartOf(const SurfacePatch& whole, const SurfacePatch& cell) {
  if (!LiesNear(whole, cell)) return std::nullopt;
  const auto exact = [](double) { return kExactSurfaceMm; };
  SurfacePatch part = cell;
  const bool lies_on = whole.kind == PatchKind::kTorus
                           ? BecomeTorus(part, whole.axis, whole.origin, exact)
                           : BecomeCylinder(part, whole.axis, whole.origin, exact);
  return lies_on ? std::optional(std::move(part)) : std::nullopt;
}

// Cells that lie on one cylinder or torus.
struct OneSurface {
  SurfacePatch surface;  // as the largest has it
  Cells cells;
};

// The surface of `known` that the cell lies on, the nearest where there are several.
OneSurface* SurfaceUnder(const SurfacePatch& cell, std::vector<OneSurface>& known) {
  OneSurface* nearest = nullptr;
  double off_mm = 0;
  for (OneSurface& one : known) {
    const auto part = AsPartOf(one.surface, cell);
    if (!part || (nearest != nullptr && part->off_mm >= off_mm)) continue;
    nearest = &one;
    off_mm = part->off_mm;
  }
  return nearest;
}

// Each cell as the cylinder or torus that it is. All that lie on one say where its axis is: of a
// degree of a bend, as systems leave it where they cut it off a larger one, rounding alone says
// that. What is neither stays free.
std::vector<SurfacePatch> ExactCells(Cells cells) {
  std::stable_sort(cells.begin(), cells.end(), [](const SurfacePatch* a, const SurfacePatch* b) {
    return SizeMm(*a) > SizeMm(*b);
  });
  std::vector<SurfacePatch> exact;
  std::vector<OneSurface> known;
  for (const SurfacePatch* cell : cells) {
    if (OneSurface* one = SurfaceUnder(*cell, known)) {
      one->cells.push_back(cell);
      continue;
    }
    SurfacePatch surface = *cell;
    RecogniseFreeSurface(surface);
    if (surface.kind == PatchKind::kFree) {
      exact.push_back(std::move(surface));
    } else {
      known.push_back({std::move(surface), {cell}});
    }
  }
  for (OneSurface& one : known) {
    const auto fitted = one.cells.size() > 1 ? NearSurface(one.cells) : std::nullopt;
    const bool better = fitted && fitted->kind == one.surface.kind;
    for (const SurfacePatch* cell : one.cells) {
      auto part = better ? AsPartOf(*fitted, *cell) : std::nullopt;
      if (!part) part = AsPartOf(one.surface, *cell);
      exact.push_back(part ? std::move(*part) : one.surface);
    }
  }
  return exact;
}

// What the cells of a face are; the cells themselves where they are no cylinder or torus.
std::vector<SurfacePatch> FaceOf(const Cells& cells) {
  std::vector<SurfacePatch> exact = ExactCells(cells);
  if (std::none_of(exact.begin(), exact.end(),
                   [](const SurfacePatch& cell) { return cell.kind == PatchKind::kFree; })) {
    return exact;
  }
  if (auto one = NearSurface(cells)) return {std::move(*one)};
  if (cells.size() == 1) return exact;
  std::optional<std::vector<SurfacePatch>> best;
  for (const bool along_u : {false, true}) {
    auto runs = Runs(Strips(cells, along_u));
    if (runs && (!best || runs->size() < best->size())) best = std::move(runs);
  }
  return best ? std::move(*best) : exact;
}

}  // namespace

double NearSurfaceMm(double radius_mm) { return std::min(0.005 + 0.002 * radius_mm, 0.05); }

void RecogniseFreeSurfaces(CadBody& body) {
  if (std::exchange(body.recognised, true)) return;
  std::vector<SurfacePatch> patches;
  for (std::size_t i = 0; i < body.patches.size();) {
    const int face = body.patches[i].face;
    Cells cells;
    const std::size_t first = i;
    for (; i < body.patches.size() && body.patches[i].face == face; ++i) {
      if (body.patches[i].kind == PatchKind::kFree) cells.push_back(&body.patches[i]);
    }
    if (cells.empty()) {
      std::move(body.patches.begin() + long(first), body.patches.begin() + long(i),
                std::back_inserter(patches));
      continue;
    }
    if (std::all_of(cells.begin(), cells.end(), [](const auto* c) { return IsPlane(*c); }))
      continue;
    auto found = FaceOf(cells);
    std::move(found.begin(), found.end(), std::back_inserter(patches));
  }
  body.patches = std::move(patches);
}

}  // namespace bendloop::host
