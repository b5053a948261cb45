// SPDX-License-Identifier: Apache-2.0
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Point_with_normal_3.h>
#include <CGAL/Random.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/jet_estimate_normals.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>

#include <algorithm>
#include <utility>

#include "tests/bench/rivals.h"

namespace bendloop::bench {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using PointWithNormal = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using PointMap = CGAL::First_of_pair_property_map<PointWithNormal>;
using NormalMap = CGAL::Second_of_pair_property_map<PointWithNormal>;
using Traits = CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, std::vector<PointWithNormal>,
                                                              PointMap, NormalMap>;
using Ransac = CGAL::Shape_detection::Efficient_RANSAC<Traits>;
using Cylinder = CGAL::Shape_detection::Cylinder<Traits>;
using Torus = CGAL::Shape_detection::Torus<Traits>;

constexpr unsigned kNeighbours = 18;  // what the library's own examples take
constexpr std::size_t kJetLimit = 200'000;

}  // namespace

RivalRun RunCgal(Points points_W, double pipe_radius_mm, double noise_mm) {
  std::vector<PointWithNormal> points;
  points.reserve(points_W.size());
  for (const Eigen::Vector3d& p : points_W) {
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), Kernel::Vector_3(0, 0, 0));
  }
  const auto maps = CGAL::parameters::point_map(PointMap()).normal_map(NormalMap());
  RivalRun run;
  const bool jets = points.size() <= kJetLimit;
  run.how = jets ? "jet normals, Efficient RANSAC" : "PCA normals, Efficient RANSAC";
  CGAL::get_default_random() = CGAL::Random(1);  // else it begins with the time of day
  const Stopwatch normals;
  if (jets) {
    CGAL::jet_estimate_normals<CGAL::Sequential_tag>(points, kNeighbours, maps);
  } else {
    CGAL::pca_estimate_normals<CGAL::Sequential_tag>(points, kNeighbours, maps);
  }
  run.normals = normals.Read();

  const Stopwatch shapes;
  Ransac ransac;
  ransac.set_input(points);
  ransac.add_shape_factory<Cylinder>();
  ransac.add_shape_factory<Torus>();
  Ransac::Parameters parameters;
  parameters.probability = 0.01;
  parameters.min_points = std::max<std::size_t>(50, points.size() / 100);
  parameters.epsilon = 3.0 * noise_mm;
  parameters.cluster_epsilon = 0.5 * pipe_radius_mm;
  parameters.normal_threshold = 0.9;
  ransac.detect(parameters);
  run.shapes = shapes.Read();
  for (const auto& shape : ransac.shapes()) {
    const auto* cylinder = dynamic_cast<const Cylinder*>(shape.get());
    if (cylinder == nullptr) {
      ++run.other_shapes;
      continue;
    }
    const auto point = cylinder->axis().point();
    const auto axis = cylinder->axis().to_vector();
    run.cylinders.push_back({{point.x(), point.y(), point.z()},
                             Eigen::Vector3d(axis.x(), axis.y(), axis.z()).normalized(),
                             cylinder->radius(),
                             shape->indices_of_assigned_points().size()});
  }
  return run;
}

}  // namespace bendloop::bench
