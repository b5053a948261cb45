// SPDX-License-Identifier: Apache-2.0
// The innermost loops of the fit: batches of points in structure-of-arrays form, so that roots,
// quotients and sums run several points at a time.
#include "pipeline/surface_sums.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>

namespace bendloop::pipeline {
namespace {

constexpr int kBatch = 64;
constexpr double kTiny = 1e-300;  // keeps a point on the axis from being divided by nothing
using Lane = Eigen::Array<double, kBatch, 1>;

struct Batch {
  Lane x, y, z, weight;  // in the segment's frame; an arc's y from its centre
};

// Calls `visit` with batch after batch; the last is filled up with points of weight 0.
template <class Visit>
void ForBatches(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                Visit visit) {
  Eigen::Matrix3d to_local;
  to_local.row(0) = segment.tangent;
  to_local.row(1) = segment.normal.cross(segment.tangent);
  to_local.row(2) = segment.normal;
  const double offset = segment.is_arc() ? segment.bend_radius_mm : 0.0;
  Batch batch;
  for (std::size_t first = 0; first < points.size(); first += kBatch) {
    const auto count =
        static_cast<Eigen::Index>(std::min<std::size_t>(kBatch, points.size() - first));
    for (Eigen::Index i = 0; i < count; ++i) {
      const WeightedPoint& p = points[first + static_cast<std::size_t>(i)];
      const Eigen::Vector3d local = to_local * (p.point - segment.start_mm);
      batch.x[i] = local.x();
      batch.y[i] = local.y() - offset;
      batch.z[i] = local.z();
      batch.weight[i] = p.weight;
    }
    for (Eigen::Index i = count; i < kBatch; ++i) {
      batch.x[i] = batch.y[i] = batch.z[i] = 1.0;
      batch.weight[i] = 0.0;
    }
    visit(batch);
  }
}

// The rows are linear in few functions of the point; these are summed, and `rows_of` takes them to
// the rows. `fill` writes the functions of a batch.
template <int kFunctions, class Fill>
CondensedSum SumThrough(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                        const Eigen::Matrix<double, kCondensedRow, kFunctions>& rows_of,
                        Fill fill) {
  using Functions = Eigen::Matrix<double, kBatch, kFunctions>;
  Functions functions;
  Functions weighted;
  Eigen::Matrix<double, kFunctions, kFunctions> sum =
      Eigen::Matrix<double, kFunctions, kFunctions>::Zero();
  ForBatches(points, segment, [&](const Batch& batch) {
    fill(batch, functions);
    weighted.array() = functions.array().colwise() * batch.weight;
    // The triangle as dot products: packing so small a product costs more than it saves.
    for (int j = 0; j < kFunctions; ++j) {
      for (int i = j; i < kFunctions; ++i) {
        sum(i, j) += functions.col(i).dot(weighted.col(j));
      }
    }
  });
  for (int j = 0; j < kFunctions; ++j) {
    for (int i = j + 1; i < kFunctions; ++i) sum(j, i) = sum(i, j);
  }
  return rows_of * sum * rows_of.transpose();
}

// d = |(y, z)| - r, outward o = (0, oy, oz), torque x * (0, -oz, oy).
CondensedSum SumOfLine(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                       double pipe_radius_mm) {
  enum { kOy, kOz, kXOy, kXOz, kOne, kDistance, kCount };
  Eigen::Matrix<double, kCondensedRow, kCount> rows_of =
      Eigen::Matrix<double, kCondensedRow, kCount>::Zero();
  rows_of(1, kOy) = -1;
  rows_of(2, kOz) = -1;
  rows_of(4, kXOz) = 1;
  rows_of(5, kXOy) = -1;
  rows_of(7, kOne) = -1;
  rows_of(8, kDistance) = 1;
  return SumThrough<kCount>(points, segment, rows_of, [&](const Batch& batch, auto& f) {
    const Lane distance = (batch.y.square() + batch.z.square()).sqrt().max(kTiny);
    const Lane inverse = distance.inverse();
    f.col(kOy) = batch.y * inverse;
    f.col(kOz) = batch.z * inverse;
    f.col(kXOy) = batch.x * f.col(kOy).array();
    f.col(kXOz) = batch.x * f.col(kOz).array();
    f.col(kOne).setOnes();
    f.col(kDistance) = distance - pipe_radius_mm;
  });
}

// In the plane of the bend (a, b) is the unit vector from the centre, u the distance beyond the
// spine's circle; (c, s) = (u, z) / |(u, z)|. Outward is (c a, c b, s), the torque about the start
// R (s + s b, -s a, -c a). Moving the centre by dR along +y changes u by -b dR - dR.
CondensedSum SumOfArc(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                      double pipe_radius_mm) {
  enum { kCa, kCb, kC, kSa, kSb, kS, kOne, kDistance, kCount };
  const double bend_radius_mm = segment.bend_radius_mm;
  Eigen::Matrix<double, kCondensedRow, kCount> rows_of =
      Eigen::Matrix<double, kCondensedRow, kCount>::Zero();
  rows_of(0, kCa) = -1;
  rows_of(1, kCb) = -1;
  rows_of(2, kS) = -1;
  rows_of(3, kS) = rows_of(3, kSb) = -bend_radius_mm;
  rows_of(4, kSa) = bend_radius_mm;
  rows_of(5, kCa) = bend_radius_mm;
  rows_of(6, kCb) = rows_of(6, kC) = -1;
  rows_of(7, kOne) = -1;
  rows_of(8, kDistance) = 1;
  return SumThrough<kCount>(points, segment, rows_of, [&](const Batch& batch, auto& f) {
    const Lane rho = (batch.x.square() + batch.y.square()).sqrt().max(kTiny);
    const Lane inverse_rho = rho.inverse();
    const Lane a = batch.x * inverse_rho;
    const Lane b = batch.y * inverse_rho;
    const Lane u = rho - bend_radius_mm;
    const Lane distance = (u.square() + batch.z.square()).sqrt().max(kTiny);
    const Lane inverse = distance.inverse();
    const Lane c = u * inverse;
    const Lane s = batch.z * inverse;
    f.col(kCa) = c * a;
    f.col(kCb) = c * b;
    f.col(kC) = c;
    f.col(kSa) = s * a;
    f.col(kSb) = s * b;
    f.col(kS) = s;
    f.col(kOne).setOnes();
    f.col(kDistance) = distance - pipe_radius_mm;
  });
}

}  // namespace

CondensedSum SumOfRows(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                       double pipe_radius_mm) {
  return segment.is_arc() ? SumOfArc(points, segment, pipe_radius_mm)
                          : SumOfLine(points, segment, pipe_radius_mm);
}

double SumOfSquares(const std::vector<WeightedPoint>& points, const hal::SpineSegment& segment,
                    double pipe_radius_mm) {
  const double bend_radius_mm = segment.bend_radius_mm;
  const bool is_arc = segment.is_arc();
  double sum = 0;
  ForBatches(points, segment, [&](const Batch& batch) {
    Lane u = batch.y;
    if (is_arc) u = (batch.x.square() + batch.y.square()).sqrt() - bend_radius_mm;
    const Lane d = (u.square() + batch.z.square()).sqrt() - pipe_radius_mm;
    sum += (batch.weight * d.square()).sum();
  });
  return sum;
}

}  // namespace bendloop::pipeline
