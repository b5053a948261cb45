// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cli/outlier_place.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "firmware-host/text/table.h"
#include "pipeline/math/quantiles.h"

namespace bendloop::host {
namespace {

// [of all points] Fliers and the edge of what the tube lies on are fewer.
constexpr double kFew = 0.1;
// So many points tell where they lie.
constexpr std::size_t kAsked = 5000;
// [of the pipe radius] Nearer points may be on the tube: its own noise and form.
constexpr double kOff = 0.2;

}  // namespace

std::string OutlierPlace(std::span<const Eigen::Vector3d> points_mm,
                         const pipeline::Measurement& measurement) {
  const auto off = static_cast<double>(measurement.fit.outliers);
  const double part = off / (off + static_cast<double>(measurement.fit.samples));
  if (!(part > kFew) || measurement.spine.empty()) return "";
  std::vector<double> along_mm = {0.0};
  for (std::size_t i = 1; i < measurement.spine.size(); ++i) {
    along_mm.push_back(
        along_mm.back() +
        (measurement.spine[i].position_mm - measurement.spine[i - 1].position_mm).norm());
  }
  std::vector<double> off_mm, beside_mm;
  const std::size_t stride = points_mm.size() / kAsked + 1;
  for (std::size_t i = 0; i < points_mm.size(); i += stride) {
    double nearest_mm = std::numeric_limits<double>::infinity();
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < measurement.spine.size(); ++k) {
      const double d_mm = (points_mm[i] - measurement.spine[k].position_mm).norm();
      if (!(d_mm < nearest_mm)) continue;
      nearest_mm = d_mm;
      nearest = k;
    }
    const double r_mm = measurement.spine[nearest].pipe_radius_mm;
    if (!(std::abs(nearest_mm - r_mm) > kOff * r_mm)) continue;
    off_mm.push_back(std::abs(nearest_mm - r_mm));
    beside_mm.push_back(along_mm[nearest]);
  }
  if (off_mm.empty()) return "";
  const auto most = [](const std::vector<double>& values, int decimals) {
    return Fixed(pipeline::Quantile(values, 0.1), decimals) + " to " +
           Fixed(pipeline::Quantile(values, 0.9), decimals) + " mm";
  };
  return Fixed(100 * part, 0) + " % of the points do not lie on the tube: most of them " +
         most(off_mm, 1) + " off its surface, beside " + most(beside_mm, 0) + " of it";
}

}  // namespace bendloop::host
