// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>

#include "pipeline/math/simd.h"

namespace bendloop::pipeline {

// Weighted sums over points of the products of any two of few functions, taken batch after batch.
template <int kFunctions, std::size_t kLanes>
struct ProductSums {
  alignas(32) double functions[kFunctions][kLanes];  // of the batch's points
  alignas(32) double weight[kLanes];
  alignas(32) double weighted[kLanes];
  double sum[kFunctions][kFunctions] = {};  // lower triangle
};

// Adds the batch. Four sums at a time, so that none waits for another.
template <int kFunctions, std::size_t kLanes>
BENDLOOP_LOOP void AddProducts(ProductSums<kFunctions, kLanes>& sums) {
  for (int j = 0; j < kFunctions; ++j) {
    const double* fj = sums.functions[j];
    for (std::size_t l = 0; l < kLanes; ++l) sums.weighted[l] = fj[l] * sums.weight[l];
    for (int i = j; i < kFunctions; i += 4) {
      const double* f0 = sums.functions[i];
      const double* f1 = sums.functions[std::min(i + 1, kFunctions - 1)];
      const double* f2 = sums.functions[std::min(i + 2, kFunctions - 1)];
      const double* f3 = sums.functions[std::min(i + 3, kFunctions - 1)];
      double s0 = 0, s1 = 0, s2 = 0, s3 = 0;
#pragma omp simd reduction(+ : s0, s1, s2, s3)
      for (std::size_t l = 0; l < kLanes; ++l) {
        s0 += f0[l] * sums.weighted[l];
        s1 += f1[l] * sums.weighted[l];
        s2 += f2[l] * sums.weighted[l];
        s3 += f3[l] * sums.weighted[l];
      }
      sums.sum[i][j] += s0;
      if (i + 1 < kFunctions) sums.sum[i + 1][j] += s1;
      if (i + 2 < kFunctions) sums.sum[i + 2][j] += s2;
      if (i + 3 < kFunctions) sums.sum[i + 3][j] += s3;
    }
  }
}

}  // namespace bendloop::pipeline
