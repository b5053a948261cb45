// SPDX-License-Identifier: Apache-2.0
#include "pipeline/fit/end_face.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace bendloop::pipeline {
namespace {

struct EndFaceSettings {
  // [sigma] About the end, where a face may lie; and how much of the wall before it tells how dense
  // samples are without.
  double before = 8.0, beyond = 4.0, wall = 16.0;
  // Samples that are too many for the wall, and how many times as many as it has there.
  double least = 12.0, times = 1.0;
  // [sigma] A face that is wider is oblique, or none. [sigma] No place is known better.
  double widest = 1.5, surest = 0.1;
  int rounds = 20;
  // Of the wall before it: samples at least, and by how much more than by chance their numbers in
  // places 1 sigma long differ, as those of laser lines do.
  double least_of_wall = 16.0, uneven = 3.0;
};
constexpr EndFaceSettings kFace;

}  // namespace

std::optional<EndFace> FindEndFace(std::span<const double> places_mm, double end_mm,
                                   double noise_mm) {
  if (!(noise_mm > 0)) return std::nullopt;
  // From `end_mm`, in sigma of noise.
  const auto place = [&](double at_mm) { return (at_mm - end_mm) / noise_mm; };
  double of_wall = 0, n = 0, sum = 0, square = 0;
  std::array<double, static_cast<std::size_t>(kFace.wall)> wall{};
  for (const double at_mm : places_mm) {
    const double at = place(at_mm);
    if (at < -kFace.before - kFace.wall || at > kFace.beyond) continue;
    if (at < -kFace.before) {
      of_wall += 1;
      const double from_first = at + kFace.before + kFace.wall;
      wall[std::min(wall.size() - 1, static_cast<std::size_t>(from_first))] += 1;
    } else {
      n += 1, sum += at, square += at * at;
    }
  }
  // The wall goes on up to the face, as dense as before it.
  const double density = of_wall / kFace.wall;
  double uneven = 0;
  for (const double count : wall) uneven += (count - density) * (count - density);
  if (of_wall < kFace.least_of_wall || uneven > kFace.uneven * of_wall) return std::nullopt;
  const double from = -kFace.before;
  double face = 0, of_face = 0;
  for (int i = 0; i < kFace.rounds; ++i) {
    of_face = n - density * (face - from);
    if (of_face < kFace.least || of_face < kFace.times * density * (face - from)) {
      return std::nullopt;
    }
    face = (sum - 0.5 * density * (face * face - from * from)) / of_face;
    face = std::clamp(face, from, kFace.beyond);
  }
  const double cubes = (face * face * face - from * from * from) / 3.0;
  const double variance = (square - density * cubes) / of_face - face * face;
  if (!(variance < kFace.widest * kFace.widest)) return std::nullopt;
  const double sigma = std::sqrt(std::max(0.0, variance) / of_face);
  return EndFace{end_mm + noise_mm * face, noise_mm * std::hypot(sigma, kFace.surest)};
}

}  // namespace bendloop::pipeline
