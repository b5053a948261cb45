// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/end_bevel.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "hal/angles.h"
#include "pipeline/features/sampling.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::pipeline {
namespace {

struct BevelSettings {
  // Samples beyond the wall's border, and sectors that have some, of a bevel.
  std::size_t least_inside = 24, least_sectors = 8;
  // Whatever lies further beyond the wall's border, or the face, than `face_beyond`, and as far in,
  // may be a bevel's, if they are so many, and such a part of all.
  std::size_t few_inside = 6, few_sectors = 3;
  double few_part = 0.15;
  // [of r_P] A bevel reaches no further beyond the wall's border, nor further in.
  double longest = 0.8, deepest = 0.5;
  // [of r_P] and [sigma] Its cone begins no further from the wall's border.
  double begins = 0.1;
  // Of the cone: what is steeper is the cut itself, what is flatter the wall.
  double least_fall = 0.1, most_fall = 6.0;
  // [sigma] Samples further off are none of the cone's; and how much of them all it explains.
  double off = 4.0, least_part = 0.7;
  int rounds = 6;
  // [sigma] Deeper than the wall's samples are taken, so that noise has no say in which are.
  double fair = 3.0;
  // [sigma] Samples no further from the face of the cut may be its own.
  double of_face = 3.0;
  // Of how far [sigma2] samples lie from the face: a cone that leaves more is none. And [sigma2]
  // how much more the face must leave: by so much a cone explains by chance, of many samples or of
  // each of few.
  double least_better = 0.5, by_chance = 100.0, by_chance_each = 2.0;
  // [sigma] A face that lies so far beyond the wall's border has something between.
  double face_beyond = 3.0;
  // [sigma] From which on a cone follows another plane; about that it has to keep so much of its
  // samples.
  double tilted = 3.0, kept = 0.9;
};
constexpr BevelSettings kBevel;

// Sums of a straight line through samples: how far in they are, by how far beyond.
struct LineSums {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  void Add(double at, double in) { n += 1, x += at, y += in, xx += at * at, xy += at * in; }
  double Spread() const { return xx - x * x / n; }
  double Slope() const { return (xy - x * y / n) / Spread(); }
};

// `beyond_mm`: the plane itself, which goes on into the tube. The face of the cut lies in one, and
// a bevel goes as far from it at any depth.
struct InsideSample {
  std::size_t index;
  double beyond_mm, in_mm;
};

std::size_t SectorsOf(const SamplesNearEnd& near, std::span<const InsideSample> inside) {
  EndSectors seen{};
  for (const InsideSample& sample : inside) {
    seen[EndSectorOf(near.inside()[sample.index].AroundRad())] = true;
  }
  return static_cast<std::size_t>(std::count(seen.begin(), seen.end(), true));
}

bool AreEnough(const SamplesNearEnd& near, std::span<const InsideSample> inside) {
  return inside.size() >= kBevel.least_inside && SectorsOf(near, inside) >= kBevel.least_sectors;
}

// Samples inside, beyond the plane, that may be a bevel's or the cut's own face.
std::vector<InsideSample> InsideOf(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm,
                                   double r_mm) {
  std::vector<InsideSample> inside;
  for (std::size_t i = 0; i < near.inside().size(); ++i) {
    const NearEnd& sample = near.inside()[i];
    const double beyond_mm = sample.BeyondInsideMm(plane_mm, r_mm);
    const double in_mm = r_mm - sample.RadiusMm();
    if (beyond_mm < 0 || beyond_mm > kBevel.longest * r_mm || in_mm > kBevel.deepest * r_mm)
      continue;
    inside.push_back({i, beyond_mm, in_mm});
  }
  return inside;
}

// The middle of those that most lie no wider apart than this with.
double MiddleOfMost(std::vector<double> places, double wide) {
  std::sort(places.begin(), places.end());
  double middle = 0;
  std::size_t most = 0;
  for (std::size_t first = 0, end = 0; first < places.size(); ++first) {
    while (end < places.size() && places[end] - places[first] <= wide) ++end;
    if (end - first <= most) continue;
    most = end - first;
    middle = places[first + most / 2];
  }
  return middle;
}

// A plane as the cut's, that most of the samples lie in.
struct CutFace {
  double beyond_mm = 0, cosine = 1;  // of the cut's plane; of its normal, to the tube

  double Squares(const InsideSample& sample, double noise_mm) const {
    return std::pow((sample.beyond_mm - beyond_mm) * cosine / noise_mm, 2);
  }
};
CutFace FaceOf(std::span<const InsideSample> inside, const Eigen::Vector3d& plane_mm, double r_mm,
               double noise_mm) {
  CutFace face;
  face.cosine = r_mm / std::hypot(r_mm, plane_mm.tail<2>().norm());
  std::vector<double> off_mm;
  for (const InsideSample& sample : inside) off_mm.push_back(sample.beyond_mm);
  face.beyond_mm = MiddleOfMost(std::move(off_mm), 2.0 * kBevel.of_face * noise_mm / face.cosine);
  return face;
}

// A cone as a line through how far in samples lie, by how far beyond.
struct Cone {
  EndBevel bevel;
  LineSums sums;

  double OffMm(const InsideSample& sample) const {
    return sample.in_mm - bevel.fall * (sample.beyond_mm - bevel.begins_mm);
  }
  // The line through those that lie no further off. None: they tell of none, or it is no cone.
  bool Take(std::span<const InsideSample> inside, double reach_mm, double noise_mm) {
    // Where it begins noise decides which samples are still the wall's: those are no fair ones.
    const double fair_mm = (kSampling.on_surface + kBevel.fair) * noise_mm;
    LineSums taken;
    for (const InsideSample& sample : inside) {
      const bool is_fair =
          sums.n == 0 || bevel.fall * (sample.beyond_mm - bevel.begins_mm) > fair_mm;
      if (is_fair && std::abs(OffMm(sample)) < reach_mm) taken.Add(sample.beyond_mm, sample.in_mm);
    }
    sums = taken;
    if (sums.n < static_cast<double>(kBevel.least_inside) || !(sums.Spread() > 0)) return false;
    bevel.fall = sums.Slope();
    bevel.begins_mm = (sums.x - sums.y / bevel.fall) / sums.n;
    return bevel.fall > kBevel.least_fall && bevel.fall < kBevel.most_fall;
  }
  // `scatter_mm`: of samples off it. Whether it begins at the wall's border.
  bool Know(double scatter_mm, double r_mm) {
    // At their mean the line is surest; the wall's radius, which it begins at, is known better.
    const double at_mm = sums.x / sums.n - bevel.begins_mm;
    const double of_mean = scatter_mm * scatter_mm / sums.n;
    const double of_fall = scatter_mm * scatter_mm / sums.Spread();
    const double fall2 = bevel.fall * bevel.fall;
    bevel.covariance << (of_mean + at_mm * at_mm * of_fall) / fall2, at_mm * of_fall / bevel.fall,
        at_mm * of_fall / bevel.fall, of_fall;
    return std::abs(bevel.begins_mm) <
           kBevel.begins * r_mm + kBevel.off * std::sqrt(bevel.covariance(0, 0));
  }
  void TakeSamples(const SamplesNearEnd& near, std::span<const InsideSample> inside,
                   double reach_mm) {
    bevel.samples.clear();
    for (const InsideSample& sample : inside) {
      if (std::abs(OffMm(sample)) < reach_mm) bevel.samples.push_back(near.inside()[sample.index]);
    }
  }
};

// The cone that most of these samples lie on. None: they lie on none that begins at the border.
std::optional<Cone> FitCone(const SamplesNearEnd& near, std::span<const InsideSample> inside,
                            double r_mm, double noise_mm) {
  if (!AreEnough(near, inside)) return std::nullopt;
  Cone cone;
  double scatter_mm = noise_mm;
  if (!cone.Take(inside, kBevel.deepest * r_mm, noise_mm)) return std::nullopt;
  for (int round = 1; round < kBevel.rounds; ++round) {
    std::vector<double> off;
    for (const InsideSample& sample : inside) off.push_back(std::abs(cone.OffMm(sample)));
    constexpr double kPerMedian = 1.4826;
    scatter_mm = std::max(noise_mm, kPerMedian * Median(std::move(off)));
    if (!cone.Take(inside, kBevel.off * scatter_mm, noise_mm)) return std::nullopt;
  }
  if (!cone.Know(scatter_mm, r_mm)) return std::nullopt;
  cone.TakeSamples(near, inside, kBevel.off * scatter_mm);
  if (static_cast<double>(cone.bevel.samples.size()) <
      kBevel.least_part * static_cast<double>(inside.size())) {
    return std::nullopt;
  }
  return cone;
}

// The same of those that lie within the noise of where most of them do: mixed pixels lie below a
// bevel, all on one side, and lead the line through all aside.
std::optional<Cone> Sharpened(const Cone& cone, const SamplesNearEnd& near,
                              std::span<const InsideSample> inside, double r_mm, double noise_mm) {
  Cone sharp = cone;
  std::vector<double> off_mm;
  for (const InsideSample& sample : inside) off_mm.push_back(cone.OffMm(sample));
  const double reach_mm = kBevel.off * noise_mm * std::hypot(1.0, cone.bevel.fall);
  sharp.bevel.begins_mm -= MiddleOfMost(std::move(off_mm), 2.0 * reach_mm) / sharp.bevel.fall;
  for (int round = 0; round < kBevel.rounds; ++round) {
    if (!sharp.Take(inside, reach_mm, noise_mm)) return std::nullopt;
  }
  if (!sharp.Know(noise_mm, r_mm)) return std::nullopt;
  sharp.TakeSamples(near, inside, reach_mm);
  return sharp;
}

}  // namespace

double EndBevel::SigmasOff(double beyond_mm, double in_mm, double noise_mm) const {
  return (in_mm - fall * (beyond_mm - begins_mm)) / (noise_mm * std::hypot(1.0, fall));
}

BevelFound EndBevel::Found(double ends_mm, double sigma_mm) const {
  BevelFound found;
  const double begins_sigma_mm = std::sqrt(covariance(0, 0));
  const double fall_sigma = std::sqrt(covariance(1, 1));
  found.length_mm = ends_mm - begins_mm;
  found.length_sigma_mm = std::hypot(sigma_mm, begins_sigma_mm);
  found.depth_mm = fall * found.length_mm;
  // By how far it begins, how fast it falls, and where the tube ends.
  const Eigen::Vector2d row(-fall, found.length_mm);
  found.depth_sigma_mm =
      std::sqrt(std::max(0.0, row.dot(covariance * row)) + fall * fall * sigma_mm * sigma_mm);
  found.angle_deg = std::atan(fall) * hal::kDegreesPerRadian;
  found.angle_sigma_deg = fall_sigma / (1.0 + fall * fall) * hal::kDegreesPerRadian;
  return found;
}

namespace {

// Of a cone that ends at a face: its samples up to there, but those that lie so low that they may
// be of the face.
void TakeSamples(const SamplesNearEnd& near, std::span<const InsideSample> inside,
                 const CutFace& face, double noise_mm, EndBevel& bevel) {
  bevel.samples.clear();
  for (const InsideSample& sample : inside) {
    const double low = bevel.SigmasOff(sample.beyond_mm, sample.in_mm, noise_mm);
    const bool is_at_face = face.Squares(sample, noise_mm) < kBevel.of_face * kBevel.of_face;
    if (low > -kBevel.off && low < (is_at_face ? kSampling.low : kBevel.off)) {
      bevel.samples.push_back(near.inside()[sample.index]);
    }
  }
}

// What a cone leaves, and what the face alone does [sigma2]: of all samples; of some of them what
// is off both, fliers, as mixed pixels at the edge are, which say nothing of which of these it is,
// but do of which cone.
struct Left {
  double all = 0, by_face = 0, off_both = 0;
  std::size_t below = 0;  // the cone, at the face
  double by_chance = 0;

  bool IsBetterThanFace() const {
    return all - off_both <= kBevel.least_better * (by_face - off_both) - by_chance;
  }
};
// `has_face`: the cone ends at it.
Left LeftBy(const EndBevel& cone, bool has_face, std::span<const InsideSample> inside,
            const CutFace& face, double noise_mm) {
  constexpr double kMost = kBevel.off * kBevel.off;  // counts of a sample
  Left left;
  left.by_chance =
      std::min(kBevel.by_chance, kBevel.by_chance_each * static_cast<double>(inside.size()));
  for (const InsideSample& sample : inside) {
    const double off = cone.SigmasOff(sample.beyond_mm, sample.in_mm, noise_mm);
    const double at_face = face.Squares(sample, noise_mm);
    if (off * off > kMost && at_face > kMost) left.off_both += kMost;
    left.by_face += std::min(kMost, at_face);
    left.all += std::min({kMost, off * off, has_face ? at_face : kMost});
    left.below += off > kBevel.off && at_face < kBevel.of_face * kBevel.of_face ? 1 : 0;
  }
  return left;
}

double GoesOnMm(std::span<const InsideSample> inside) {
  std::vector<double> beyond_mm;
  for (const InsideSample& sample : inside) beyond_mm.push_back(sample.beyond_mm);
  return Quantile(std::move(beyond_mm), 0.95);
}

// How far some go on beyond there, though no cone may be told by them; or nothing.
double SomeGoOnMm(const SamplesNearEnd& near, std::span<const InsideSample> inside, double from_mm,
                  double noise_mm) {
  const double least_mm = kBevel.face_beyond * noise_mm;
  std::vector<InsideSample> beyond;
  for (const InsideSample& sample : inside) {
    if (sample.beyond_mm > from_mm + least_mm && sample.in_mm > least_mm) beyond.push_back(sample);
  }
  const double least = std::max(static_cast<double>(kBevel.few_inside),
                                kBevel.few_part * static_cast<double>(inside.size()));
  const bool are_some =
      static_cast<double>(beyond.size()) >= least && SectorsOf(near, beyond) >= kBevel.few_sectors;
  return are_some ? GoesOnMm(beyond) : 0.0;
}

// With the likeliest cone, told or not.
struct ConeSearch {
  BevelSearch search;
  std::optional<EndBevel> cone;
};
ConeSearch FindConeAt(const Eigen::Vector3d& plane_mm, const SamplesNearEnd& near, double r_mm,
                      double noise_mm) {
  const std::vector<InsideSample> inside = InsideOf(near, plane_mm, r_mm);
  if (!AreEnough(near, inside)) return {{{}, SomeGoOnMm(near, inside, 0.0, noise_mm)}, {}};
  const CutFace face = FaceOf(inside, plane_mm, r_mm, noise_mm);
  // A bevel may leave some of the face.
  std::vector<InsideSample> off_face;
  for (const InsideSample& sample : inside) {
    if (face.Squares(sample, noise_mm) > kBevel.of_face * kBevel.of_face)
      off_face.push_back(sample);
  }
  double least = std::numeric_limits<double>::infinity();
  ConeSearch found_at;
  BevelSearch& found = found_at.search;
  // Of a square or oblique cut the face lies where the wall ends.
  if (face.beyond_mm * face.cosine > kBevel.face_beyond * noise_mm) {
    found.perhaps_mm = face.beyond_mm;
  }
  found.perhaps_mm =
      std::max(found.perhaps_mm, SomeGoOnMm(near, inside, std::max(0.0, face.beyond_mm), noise_mm));
  for (const bool has_face : {false, true}) {
    const std::vector<InsideSample>& of_cone = has_face ? off_face : inside;
    const auto wide = FitCone(near, of_cone, r_mm, noise_mm);
    if (!wide) continue;
    for (auto cone : {wide, Sharpened(*wide, near, of_cone, r_mm, noise_mm)}) {
      if (!cone) continue;
      const Left left = LeftBy(cone->bevel, has_face, inside, face, noise_mm);
      if (has_face && left.below < kBevel.least_inside) continue;
      const bool is_told = left.IsBetterThanFace();
      if (!is_told && left.all < left.by_face - left.by_chance) {
        found.perhaps_mm = GoesOnMm(inside);
      }
      // Nothing but one that is told takes the place of one that is.
      if (found.bevel && (!is_told || left.all > least - kBevel.by_chance)) continue;
      if (!is_told && left.all > least) continue;
      least = left.all;
      found_at.cone = cone->bevel;
      if (!is_told) continue;
      found.bevel = std::move(cone->bevel);
      if (!has_face) continue;
      TakeSamples(near, inside, face, noise_mm, *found.bevel);
      found.bevel->face_mm = face.beyond_mm;
    }
  }
  return found_at;
}

// By how much the plane that a cone follows rises against the one that it was found about, with the
// cosine and the sine of the angle around; none: its samples do not say so.
std::optional<Eigen::Vector2d> TiltOf(const EndBevel& cone, const Eigen::Vector3d& plane_mm,
                                      double r_mm, double noise_mm) {
  // How far in, by how far beyond, and around.
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  for (const NearEnd& sample : cone.samples) {
    const Eigen::Vector4d row(sample.BeyondInsideMm(plane_mm, r_mm), 1.0, sample.x / r_mm,
                              sample.y / r_mm);
    normal += row * row.transpose();
    right += (r_mm - sample.RadiusMm()) * row;
  }
  const Eigen::FullPivLU<Eigen::Matrix4d> solver(normal);
  if (!solver.isInvertible()) return std::nullopt;
  const Eigen::Vector4d fit = solver.solve(right);
  const double variance = noise_mm * noise_mm * (1.0 + fit[0] * fit[0]);
  const Eigen::Matrix2d of_rise = variance * solver.inverse().bottomRightCorner<2, 2>();
  const Eigen::Vector2d rise = fit.tail<2>();
  if (!(fit[0] > kBevel.least_fall) ||
      rise.dot(of_rise.inverse() * rise) < kBevel.tilted * kBevel.tilted) {
    return std::nullopt;
  }
  return Eigen::Vector2d(-rise / fit[0]);
}

}  // namespace

BevelSearch FindBevel(const SamplesNearEnd& near, const Eigen::Vector3d& plane_mm, double r_mm,
                      double noise_mm) {
  Eigen::Vector3d plane = plane_mm;
  ConeSearch found = FindConeAt(plane, near, r_mm, noise_mm);
  for (int round = 0; round < kBevel.rounds && found.cone; ++round) {
    const auto tilt = TiltOf(*found.cone, plane, r_mm, noise_mm);
    if (!tilt) break;
    plane.tail<2>() += *tilt;
    ConeSearch along = FindConeAt(plane, near, r_mm, noise_mm);
    const auto samples = [](const ConeSearch& of) {
      return of.cone ? static_cast<double>(of.cone->samples.size()) : 0.0;
    };
    if (samples(along) < kBevel.kept * samples(found)) break;
    found = std::move(along);
  }
  return std::move(found.search);
}

}  // namespace bendloop::pipeline
