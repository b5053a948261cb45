// SPDX-License-Identifier: Apache-2.0
#include "pipeline/features/convex_hull.h"

#include <libqhull_r/qhull_ra.h>

#include <algorithm>
#include <cstdio>
#include <limits>
#include <memory>
#include <numeric>

#include "pipeline/features/point_characteristics.h"

namespace bendloop::pipeline {
namespace {

using Eigen::Vector3d;

// Planes in a tree, so that most of them need not be asked about each point.
class PlaneTree {
 public:
  explicit PlaneTree(std::vector<HullPlane> planes) : planes_(std::move(planes)) {
    Build(0, planes_.size());
  }

  // Of a point inside: the least distance to a plane, which is the least to the hull.
  double LeastMm(const Vector3d& at) const {
    double least = std::numeric_limits<double>::infinity();
    Ask(0, at, least);
    return std::max(0.0, least);
  }

 private:
  static constexpr std::size_t kLeaf = 8;

  struct Node {
    Vector3d low, high;    // of the normals
    double offset_mm = 0;  // the most
    std::size_t from = 0, to = 0;
    std::size_t right = 0;  // the left child follows its parent; 0: a leaf
  };

  std::size_t Build(std::size_t from, std::size_t to) {
    const std::size_t number = nodes_.size();
    Node node{planes_[from].normal, planes_[from].normal, planes_[from].offset_mm, from, to, 0};
    for (std::size_t i = from; i < to; ++i) {
      node.low = node.low.cwiseMin(planes_[i].normal);
      node.high = node.high.cwiseMax(planes_[i].normal);
      node.offset_mm = std::max(node.offset_mm, planes_[i].offset_mm);
    }
    nodes_.push_back(node);
    if (to - from <= kLeaf) return number;
    Eigen::Index axis = 0;
    (node.high - node.low).maxCoeff(&axis);
    const std::size_t middle = (from + to) / 2;
    const auto begin = planes_.begin();
    std::nth_element(
        begin + static_cast<std::ptrdiff_t>(from), begin + static_cast<std::ptrdiff_t>(middle),
        begin + static_cast<std::ptrdiff_t>(to),
        [axis](const HullPlane& a, const HullPlane& b) { return a.normal[axis] < b.normal[axis]; });
    Build(from, middle);
    const std::size_t right = Build(middle, to);
    nodes_[number].right = right;
    return number;
  }

  // No plane of the node is nearer.
  static double Bound(const Node& node, const Vector3d& at) {
    return -node.offset_mm - node.low.cwiseProduct(at).cwiseMax(node.high.cwiseProduct(at)).sum();
  }

  void Ask(std::size_t number, const Vector3d& at, double& least) const {
    const Node& node = nodes_[number];
    if (node.right == 0) {
      for (std::size_t i = node.from; i < node.to; ++i) {
        least = std::min(least, -(planes_[i].normal.dot(at) + planes_[i].offset_mm));
      }
      return;
    }
    std::size_t first = number + 1, second = node.right;
    double first_mm = Bound(nodes_[first], at), second_mm = Bound(nodes_[second], at);
    if (second_mm < first_mm) {
      std::swap(first, second);
      std::swap(first_mm, second_mm);
    }
    if (first_mm < least) Ask(first, at, least);
    if (second_mm < least) Ask(second, at, least);
  }

  std::vector<HullPlane> planes_;
  std::vector<Node> nodes_;
};

struct Qhull {
  qhT state{};
  ~Qhull() {
    qh_freeqhull(&state, !qh_ALL);
    int left = 0, total = 0;
    qh_memfreeshort(&state, &left, &total);
  }
};

}  // namespace

hal::Result<std::vector<HullPlane>> ConvexHull(std::span<const Vector3d> points_mm) {
  const auto no_body = [] {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "the points span no body (all in a plane, a line or a place): nothing stands "
                     "out of them; scan more than one side");
  };
  if (points_mm.size() < 4) return no_body();
  std::vector<double> coordinates;
  coordinates.reserve(3 * points_mm.size());
  for (const Vector3d& p : points_mm) coordinates.insert(coordinates.end(), {p.x(), p.y(), p.z()});
  const auto qhull = std::make_unique<Qhull>();
  qhT* qh = &qhull->state;
  // It writes its messages somewhere; nobody reads them.
  const std::unique_ptr<FILE, int (*)(FILE*)> nowhere(std::fopen("/dev/null", "w"), &std::fclose);
  if (!nowhere) return hal::Fail(hal::ErrorKind::kDevice, "/dev/null cannot be opened");
  qh_zero(qh, nowhere.get());
  char options[] = "qhull Qt Pp";  // facets are triangles, no warnings of how thin they are
  if (qh_new_qhull(qh, 3, static_cast<int>(points_mm.size()), coordinates.data(), False, options,
                   nowhere.get(), nowhere.get()) != 0) {
    return no_body();
  }
  std::vector<HullPlane> planes;
  facetT* facet = nullptr;
  FORALLfacets { planes.push_back({Eigen::Map<const Vector3d>(facet->normal), facet->offset}); }
  if (planes.size() < 4) return no_body();
  return planes;
}

hal::Result<std::vector<double>> ConcavityMm(std::span<const Vector3d> points_mm,
                                             Workers* workers) {
  if (points_mm.empty()) return std::vector<double>();
  // Around the middle, so that places and planes are told apart to the last digit.
  const Vector3d middle =
      std::accumulate(points_mm.begin(), points_mm.end(), Vector3d(Vector3d::Zero())) /
      static_cast<double>(points_mm.size());
  std::vector<Vector3d> centred(points_mm.begin(), points_mm.end());
  for (Vector3d& p : centred) p -= middle;
  auto planes = ConvexHull(centred);
  if (!planes) return hal::Fail(planes.error());
  const PlaneTree tree(std::move(*planes));
  std::vector<double> concavity_mm(centred.size());
  constexpr std::size_t kOfRound = 4096;
  ParallelFor(workers, (centred.size() + kOfRound - 1) / kOfRound, [&](std::size_t round) {
    const std::size_t end = std::min(centred.size(), (round + 1) * kOfRound);
    for (std::size_t i = round * kOfRound; i < end; ++i) concavity_mm[i] = tree.LeastMm(centred[i]);
  });
  return concavity_mm;
}

}  // namespace bendloop::pipeline
