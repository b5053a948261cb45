// SPDX-License-Identifier: Apache-2.0
#include "pipeline/math/ball_lanes.h"

#include <array>
#include <cstdint>

#include "pipeline/math/simd.h"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace bendloop::pipeline {
namespace {

// Writes every point and steps on where it is one of the ball's: a branch would be guessed wrong
// for every third.
std::size_t AddOneByOne(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d& center,
                        double scale, const CoordinateLanes& to, std::size_t count) {
  for (const Eigen::Vector3d& point : points) {
    const Eigen::Vector3d p = scale * (point - center);
    to.x[count] = p.x();
    to.y[count] = p.y();
    to.z[count] = p.z();
    count += p.squaredNorm() < 1.0 ? 1 : 0;
  }
  return count;
}

#if defined(__x86_64__)

// Where the numbers of four go that are to be kept, as halves: those of set bits in front.
constexpr auto kKeep = [] {
  std::array<std::array<std::int32_t, 8>, 16> order{};
  for (std::size_t bits = 0; bits < 16; ++bits) {
    std::size_t next = 0;
    for (std::int32_t i = 0; i < 4; ++i) {
      if ((bits >> i & 1) == 0) continue;
      order[bits][next++] = 2 * i;
      order[bits][next++] = 2 * i + 1;
    }
  }
  return order;
}();

// Four points at a time. No compiler makes this of a loop. Without FMA, which would round the
// squares differently: a point would be in the ball on one processor and not on another.
__attribute__((target("avx2"))) std::size_t AddByFours(std::span<const Eigen::Vector3d> points,
                                                       const Eigen::Vector3d& center, double scale,
                                                       const CoordinateLanes& to) {
  const __m256d cx = _mm256_set1_pd(center.x()), cy = _mm256_set1_pd(center.y()),
                cz = _mm256_set1_pd(center.z()), unit = _mm256_set1_pd(scale),
                one = _mm256_set1_pd(1.0);
  std::size_t count = 0;
  for (std::size_t i = 0; i + 4 <= points.size(); i += 4) {
    const double* p = points[i].data();
    const __m256d xy = _mm256_loadu2_m128d(p + 6, p);       // x0 y0 x2 y2
    const __m256d zx = _mm256_loadu2_m128d(p + 8, p + 2);   // z0 x1 z2 x3
    const __m256d yz = _mm256_loadu2_m128d(p + 10, p + 4);  // y1 z1 y3 z3
    const __m256d x = _mm256_mul_pd(unit, _mm256_sub_pd(_mm256_shuffle_pd(xy, zx, 0b1010), cx));
    const __m256d y = _mm256_mul_pd(unit, _mm256_sub_pd(_mm256_shuffle_pd(xy, yz, 0b0101), cy));
    const __m256d z = _mm256_mul_pd(unit, _mm256_sub_pd(_mm256_shuffle_pd(zx, yz, 0b1010), cz));
    const __m256d square =
        _mm256_add_pd(_mm256_add_pd(_mm256_mul_pd(x, x), _mm256_mul_pd(y, y)), _mm256_mul_pd(z, z));
    const auto inside =
        static_cast<std::size_t>(_mm256_movemask_pd(_mm256_cmp_pd(square, one, _CMP_LT_OQ)));
    const __m256i keep = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(kKeep[inside].data()));
    const auto put = [keep](double* at, __m256d values) __attribute__((target("avx2"))) {
      const __m256i kept = _mm256_permutevar8x32_epi32(_mm256_castpd_si256(values), keep);
      _mm256_storeu_pd(at, _mm256_castsi256_pd(kept));
    };
    put(to.x + count, x);
    put(to.y + count, y);
    put(to.z + count, z);
    count += static_cast<std::size_t>((0x4332322132212110U >> (4 * inside)) & 7U);  // bits set
  }
  return AddOneByOne(points.last(points.size() % 4), center, scale, to, count);
}

#endif

}  // namespace

std::size_t GatherInBall(std::span<const Eigen::Vector3d> points, const Eigen::Vector3d& center,
                         double scale, const CoordinateLanes& to) {
#if defined(__x86_64__)
  if (uses_avx2) return AddByFours(points, center, scale, to);
#endif
  return AddOneByOne(points, center, scale, to, 0);
}

}  // namespace bendloop::pipeline
