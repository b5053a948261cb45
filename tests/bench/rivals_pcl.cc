// SPDX-License-Identifier: Apache-2.0
#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <algorithm>
#include <iterator>
#include <memory>

#include "tests/bench/rivals.h"

namespace bendloop::bench {
namespace {

// As in the library's own example of cylinder segmentation.
constexpr int kNeighbours = 50;
constexpr double kNormalWeight = 0.1;
constexpr int kIterations = 10'000;

constexpr std::size_t kMostCylinders = 30;

}  // namespace

RivalRun RunPcl(Points points_W, double pipe_radius_mm, double noise_mm) {
  const auto cloud = std::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  cloud->reserve(points_W.size());
  for (const Eigen::Vector3d& p : points_W) {
    cloud->emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()),
                        static_cast<float>(p.z()));
  }
  RivalRun run;
  run.how = "PCA normals (NormalEstimation), RANSAC cylinders one by one";
  const Stopwatch normal_watch;
  const auto normals = std::make_shared<pcl::PointCloud<pcl::Normal>>();
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(cloud);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>());
  estimation.setKSearch(kNeighbours);
  estimation.compute(*normals);
  run.normals = normal_watch.Read();

  const Stopwatch shape_watch;
  pcl::SACSegmentationFromNormals<pcl::PointXYZ, pcl::Normal> segmentation;
  segmentation.setOptimizeCoefficients(true);
  segmentation.setModelType(pcl::SACMODEL_CYLINDER);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setNormalDistanceWeight(kNormalWeight);
  segmentation.setMaxIterations(kIterations);
  segmentation.setDistanceThreshold(3.0 * noise_mm);
  segmentation.setRadiusLimits(0.5 * pipe_radius_mm, 2.0 * pipe_radius_mm);
  segmentation.setInputCloud(cloud);
  segmentation.setInputNormals(normals);
  const auto rest = std::make_shared<pcl::Indices>(cloud->size());
  for (std::size_t i = 0; i < rest->size(); ++i) (*rest)[i] = static_cast<pcl::index_t>(i);
  const std::size_t fewest = std::max<std::size_t>(50, cloud->size() / 100);
  while (rest->size() >= fewest && run.cylinders.size() < kMostCylinders) {
    segmentation.setIndices(std::make_shared<const pcl::Indices>(*rest));
    pcl::PointIndices inliers;
    pcl::ModelCoefficients c;
    segmentation.segment(inliers, c);
    if (inliers.indices.size() < fewest || c.values.size() != 7) break;
    run.cylinders.push_back({{c.values[0], c.values[1], c.values[2]},
                             Eigen::Vector3d(c.values[3], c.values[4], c.values[5]).normalized(),
                             c.values[6],
                             inliers.indices.size()});
    std::sort(inliers.indices.begin(), inliers.indices.end());
    pcl::Indices others;
    std::set_difference(rest->begin(), rest->end(), inliers.indices.begin(), inliers.indices.end(),
                        std::back_inserter(others));
    *rest = std::move(others);
  }
  run.shapes = shape_watch.Read();
  return run;
}

}  // namespace bendloop::bench
