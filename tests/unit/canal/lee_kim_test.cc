// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <string>
#include <tuple>

#include "pipeline/tube_model.h"
#include "tests/unit/canal/lee_kim_cases.h"

namespace bendloop::pipeline {
namespace {

struct Errors {
  double spine_mean = 0, spine_max = 0;
  double radius_mean = 0, radius_max = 0;
  double mean_radius = 0;
};

Errors Compare(const tests::LeeKimCase& truth, const Measurement& measurement) {
  Errors e;
  for (const SpineSample& sample : measurement.spine) {
    const auto [distance, part] = tests::Closest(truth, sample.position_mm);
    const double off = std::abs(sample.pipe_radius_mm - truth.RadiusAt(part));
    e.spine_mean += distance;
    e.spine_max = std::max(e.spine_max, distance);
    e.radius_mean += off;
    e.radius_max = std::max(e.radius_max, off);
    e.mean_radius += sample.pipe_radius_mm;
  }
  const auto n = static_cast<double>(measurement.spine.size());
  e.spine_mean /= n;
  e.radius_mean /= n;
  e.mean_radius /= n;
  return e;
}

struct Row {
  std::string name;
  tests::LeeKimCase truth;
  TubeModel model;
  double mean_radius_error_mm;  // bound of the mean error of the local radius
  double mean_spine_error_mm;   // distance to the closest point, mean
};

void PrintTo(const Row& row, std::ostream* out) { *out << row.name; }

class LeeKim : public ::testing::TestWithParam<std::tuple<SpineMethod, Row>> {
 public:
  // GoogleTest takes letters, digits and "_".
  static std::string Name(const ::testing::TestParamInfo<ParamType>& info) {
    const auto& [method, row] = info.param;
    std::string name = method == SpineMethod::kMls ? "mls_" : "shrinking_";
    for (const char c : row.name) {
      if (c != ',') name += c == ' ' ? '_' : c;
    }
    return name;
  }
};

// The bounds are about twice what is reached; the paper has 0.016 for the first radius, 0.075 and
// 0.269 for those of the canal surfaces.
TEST_P(LeeKim, SpineAndRadius) {
  const auto& [method, row] = GetParam();
  const hal::SteadyClock clock;
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(row.name + ", seed " + std::to_string(seed));
    std::mt19937_64 random(seed);
    const auto points = tests::Sample(row.truth, 2000, random);
    ReconstructionOptions options;
    options.spine_method = method;
    const auto result = ReconstructModel(points, row.model, options, clock);
    ASSERT_TRUE(result) << result.error().message;
    const Errors e = Compare(row.truth, *result);
    EXPECT_LT(e.radius_mean, row.mean_radius_error_mm);
    EXPECT_LT(e.spine_mean, row.mean_spine_error_mm);
    RecordProperty("radius_error_" + std::to_string(seed), std::to_string(e.radius_mean));
    RecordProperty("spine_error_" + std::to_string(seed), std::to_string(e.spine_mean));
    if (std::getenv("BENDLOOP_FIGURES")) {
      std::cout << row.name << ", seed " << seed << ": radius " << e.mean_radius << ", its error "
                << e.radius_mean << " mean " << e.radius_max << " max, spine " << e.spine_mean
                << " mean " << e.spine_max << " max, rows " << result->tube.program.rows.size()
                << "\n";
      for (const auto& w : result->warnings) std::cout << "    " << w << "\n";
    }
    EXPECT_GT(result->fit.samples, 1500U);
    EXPECT_GT(result->coverage, 0.95);
    ASSERT_GT(result->spine.size(), 10U);
    // A tube's last step is what is left.
    if (row.model == TubeModel::kAuto) continue;
    for (std::size_t i = 2; i < result->spine.size(); ++i) {
      const auto step = [&](std::size_t k) {
        return (result->spine[k].position_mm - result->spine[k - 1].position_mm).norm();
      };
      EXPECT_NEAR(step(i), step(1), 0.05 * step(1)) << "evenly spaced";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Tables, LeeKim,
    ::testing::Combine(
        ::testing::Values(SpineMethod::kMls, SpineMethod::kShrinking),
        ::testing::Values(
            Row{"table 1 pipe as free form", tests::Table1Pipe(), TubeModel::kFreeform, 0.004,
                0.02},
            Row{"table 1 pipe as canal", tests::Table1Pipe(), TubeModel::kCanal, 0.01, 0.02},
            Row{"table 1 pipe, auto", tests::Table1Pipe(), TubeModel::kAuto, 0.02, 0.06},
            Row{"table 2 pipe as free form", tests::Table2Pipe(), TubeModel::kFreeform, 0.008,
                0.02},
            Row{"table 1 canal", tests::Table1Canal(), TubeModel::kCanal, 0.01, 0.02},
            Row{"table 1 canal, auto", tests::Table1Canal(), TubeModel::kAuto, 0.01, 0.02},
            Row{"table 3 canal", tests::Table3Canal(), TubeModel::kCanal, 0.01, 0.02},
            Row{"table 3 canal as free form", tests::Table3Canal(), TubeModel::kFreeform, 0.01,
                0.02},
            Row{"table 3 canal, auto", tests::Table3Canal(), TubeModel::kAuto, 0.01, 0.02})),
    LeeKim::Name);

}  // namespace
}  // namespace bendloop::pipeline
