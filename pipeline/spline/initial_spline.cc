// SPDX-License-Identifier: Apache-2.0
#include "pipeline/spline/initial_spline.h"

#include <Eigen/Dense>
#include <vector>

#include "pipeline/spline/simplify.h"

namespace bendloop::pipeline {
namespace {

// How the chain of nodes becomes lines and arcs. By trial.
struct InitialSplineSettings {
  // An edge that stands for so many nodes is a line through them; a shorter one is its chord.
  std::size_t line_nodes = 8;
  // Cosine between that line and the chord: 8 degrees. More is a bend that was taken for a line.
  double least_cosine = 0.99;
  // Tolerance of the arcs: times the simplification's.
  double arc_tolerance = 2.0;
};
constexpr InitialSplineSettings kInitial;

}  // namespace

ArcLineSpline InitialSpline(const SpinePolygon& polygon, double epsilon_mm) {
  std::vector<Eigen::Vector3d> chain;
  chain.reserve(polygon.size());
  for (const SpineNode& node : polygon) chain.push_back(node.position_mm);
  const std::vector<std::size_t> kept = Simplify(chain, epsilon_mm);
  std::vector<Eigen::Vector3d> vertices;
  std::vector<TangentLine> tangents;
  for (const std::size_t k : kept) vertices.push_back(chain[k]);
  for (std::size_t e = 0; e + 1 < kept.size(); ++e) {
    const Eigen::Vector3d chord = (vertices[e + 1] - vertices[e]).normalized();
    TangentLine line{vertices[e], chord};
    if (kept[e + 1] - kept[e] >= kInitial.line_nodes) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      Eigen::Matrix3d outer = Eigen::Matrix3d::Zero();
      double count = 0;
      for (std::size_t k = kept[e] + 1; k < kept[e + 1]; ++k) {
        mean += chain[k];
        outer += chain[k] * chain[k].transpose();
        ++count;
      }
      mean /= count;
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
      eigen.computeDirect(outer / count - mean * mean.transpose());
      Eigen::Vector3d direction = eigen.eigenvectors().col(2);
      if (direction.dot(chord) < 0) direction = -direction;
      if (direction.dot(chord) > kInitial.least_cosine) {
        line = {mean + (vertices[e] - mean).dot(direction) * direction, direction};
      }
    }
    tangents.push_back(line);
  }
  return ApproximateByArcLineSpline(vertices, tangents, kInitial.arc_tolerance * epsilon_mm);
}

}  // namespace bendloop::pipeline
