// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_scanner/virtual_scan.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "drivers/scanner_wire/wire_format.h"
#include "drivers/scanner_wire/wire_messages.h"
#include "drivers/simulated_scanner/random.h"
#include "hal/angles.h"

namespace bendloop::drivers {
namespace {

using Eigen::Vector3d;

// A hit hides nothing from itself within this length.
constexpr double kSelfMm = 1e-4;

// Points along the spine, dense enough to find its lowest one to a fraction of a micrometre.
std::vector<Vector3d> SpinePoints(const std::vector<hal::SpineSegment>& spine) {
  std::vector<Vector3d> points;
  for (const hal::SpineSegment& segment : spine) {
    const int steps = segment.is_arc() ? 2000 : 20;
    for (int i = 0; i <= steps; ++i)
      points.push_back(segment.PointAt(segment.length_mm * i / steps));
  }
  return points;
}

double LowestMm(const std::vector<Vector3d>& points, const Vector3d& up) {
  double lowest = points.empty() ? 0 : points.front().dot(up);
  for (const Vector3d& point : points) lowest = std::min(lowest, point.dot(up));
  return lowest;
}

void AddClamps(const TubeSurface& part, int count, Scene& scene) {
  std::vector<const hal::SpineSegment*> straights;
  for (const hal::SpineSegment& segment : part.segments()) {
    if (!segment.is_arc() && segment.length_mm > 0) straights.push_back(&segment);
  }
  std::stable_sort(straights.begin(), straights.end(),
                   [](const auto* a, const auto* b) { return a->length_mm > b->length_mm; });
  const auto most = static_cast<std::ptrdiff_t>(straights.size());
  straights.resize(static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(count, 0, most)));
  for (const hal::SpineSegment* straight : straights) {
    Eigen::Matrix3d R_WB;
    R_WB.col(0) = straight->tangent;
    R_WB.col(2) = straight->normal;
    R_WB.col(1) = straight->normal.cross(straight->tangent);
    const double half_mm = std::min(10.0, straight->length_mm / 6);
    const double around_mm = part.pipe_radius_mm() + 5;
    scene.Add(Box{{straight->PointAt(straight->length_mm / 2), Eigen::Quaterniond(R_WB)},
                  {half_mm, around_mm, around_mm}});
  }
}

Scene MakeScene(const hal::Tube& tube, const VirtualScanOptions& options) {
  Scene scene(tube, options.features, options.wall_mm);
  const Vector3d up = options.path.up.normalized();
  if (options.clutter.table) {
    const double lowest_mm = LowestMm(SpinePoints(scene.part().segments()), up);
    scene.Add(
        TablePlane{(lowest_mm - tube.pipe_radius_mm - options.clutter.table_gap_mm) * up, up});
  }
  AddClamps(scene.part(), options.clutter.clamps, scene);
  if (options.clutter.second_tube) {
    hal::Tube second = tube;
    const Vector3d along = tube.X_WT.orientation * Vector3d::UnitX();
    Vector3d aside = up.cross(along);
    if (aside.norm() < 0.1) aside = up.unitOrthogonal();
    second.X_WT.position_mm += aside.normalized() * (2 * tube.pipe_radius_mm + 30);
    scene.Add(second);
  }
  return scene;
}

}  // namespace

VirtualScan::VirtualScan(const hal::Tube& tube, const VirtualScanOptions& options)
    : options_(options),
      scene_(MakeScene(tube, options)),
      poses_(ScanPath(scene_.part().segments(), options.path, options.seed)) {
  options_.rays = std::clamp(options_.rays, 1, static_cast<int>(kWireMaxPoints));
  for (int i = 0; i < options_.rays; ++i) {
    const double share = options_.rays == 1 ? 0.5 : double(i) / (options_.rays - 1);
    const double angle = (2 * share - 1) * options_.fan_half_angle_deg * hal::kRadiansPerDegree;
    fan_.emplace_back(std::sin(angle), std::cos(angle));
  }
}

std::int64_t VirtualScan::TimeOf(std::size_t index) const {
  const double seconds = static_cast<double>(index) / std::max(options_.profiles_per_second, 1e-3);
  return options_.start_t_ns + static_cast<std::int64_t>(std::llround(seconds * 1e9));
}

hal::ScanEvent VirtualScan::StartEvent() const {
  hal::ScanEvent event;
  event.kind = hal::ScanEventKind::kScanStart;
  event.t_ns = TimeOf(0);
  return event;
}

hal::ScanEvent VirtualScan::EndEvent() const {
  hal::ScanEvent event;
  event.kind = hal::ScanEventKind::kScanEnd;
  event.t_ns = TimeOf(poses_.empty() ? 0 : poses_.size() - 1);
  return event;
}

// What one profile sees, ray by ray.
struct VirtualScan::View {
  Random random;
  Vector3d camera;
  double least_cosine;
  const std::vector<Scene::Piece>& in_laser_plane;
  const std::vector<Scene::Piece>& before_camera;
  double along_before_mm = -1;  // of the last ray's surface, -1: none
};

std::optional<VirtualScan::Spot> VirtualScan::SpotOf(const Ray& ray, double depth,
                                                     View& view) const {
  Random& random = view.random;
  const auto hit = scene_.FirstHit(view.in_laser_plane, ray, options_.far_mm / depth);
  double along_mm = hit ? hit->along_mm : -1;
  const double before_mm = std::exchange(view.along_before_mm, along_mm);
  if (random.Chance(options_.outlier_fraction)) {
    constexpr double kWeak = 0.05;  // fliers are
    return Spot{random.Uniform(options_.near_mm, options_.far_mm) / depth, kWeak};
  }
  if (!hit) return std::nullopt;
  const double cosine = -ray.direction.dot(hit->normal);
  if (along_mm * depth < options_.near_mm || cosine < view.least_cosine) return std::nullopt;
  const Vector3d point = ray.At(along_mm);
  const Vector3d to_camera = view.camera - point;
  if (to_camera.dot(hit->normal) <= 0) return std::nullopt;
  const double camera_mm = to_camera.norm();
  if (scene_.IsBlocked(view.before_camera, {point, to_camera / camera_mm}, kSelfMm, camera_mm)) {
    return std::nullopt;
  }
  if (random.Chance(options_.dropout_fraction)) return std::nullopt;
  // Where the ray before met something else the spot lies on both.
  const bool is_edge = before_mm >= 0 && std::abs(before_mm - along_mm) > 2.0;
  if (is_edge && random.Chance(options_.mixed_pixel_fraction)) {
    along_mm += (before_mm - along_mm) * random.Uniform();
  }
  along_mm += options_.noise_mm / std::pow(cosine, options_.noise_growth) * random.Normal();
  return Spot{along_mm, cosine};
}

void VirtualScan::Make(std::size_t index, hal::LaserProfile& profile) const {
  const hal::Pose& X_WS = poses_[index];
  profile.sequence = index;
  profile.t_ns = TimeOf(index);
  profile.X_WS = X_WS;
  profile.points.clear();
  profile.intensity.clear();
  const Eigen::Matrix3d R_WS = X_WS.orientation.toRotationMatrix();
  const Vector3d y_W = R_WS.col(1);
  const double plane_mm = y_W.dot(X_WS.position_mm);
  const double baseline_mm = options_.camera_baseline_mm;
  // Thread-local so that a scan may be made by several threads and allocates only once.
  thread_local std::vector<Scene::Piece> in_laser_plane;
  thread_local std::vector<Scene::Piece> before_camera;
  scene_.PiecesIn({y_W, plane_mm, plane_mm}, in_laser_plane);
  scene_.PiecesIn(
      {y_W, plane_mm + std::min(baseline_mm, 0.0), plane_mm + std::max(baseline_mm, 0.0)},
      before_camera);
  View view{Random(options_.seed, index), X_WS.position_mm + baseline_mm * y_W,
            std::cos(options_.max_incidence_deg * hal::kRadiansPerDegree), in_laser_plane,
            before_camera};
  if (options_.pose_noise_mm > 0) {
    for (int axis = 0; axis < 3; ++axis) {
      profile.X_WS.position_mm[axis] += options_.pose_noise_mm * view.random.Normal();
    }
  }
  for (const Eigen::Vector2d& ray_S : fan_) {
    const Ray ray{X_WS.position_mm, R_WS.col(0) * ray_S.x() + R_WS.col(2) * ray_S.y()};
    const auto spot = SpotOf(ray, ray_S.y(), view);
    if (!spot) continue;
    const double x_mm = spot->along_mm * ray_S.x();
    const double z_mm = spot->along_mm * ray_S.y();
    profile.points.push_back(
        options_.quantise ? hal::ProfilePoint{RoundToWire(x_mm), RoundToWire(z_mm)}
                          : hal::ProfilePoint{static_cast<float>(x_mm), static_cast<float>(z_mm)});
    profile.intensity.push_back(
        static_cast<std::uint8_t>(std::lround(20 + 230 * std::clamp(spot->cosine, 0.0, 1.0))));
  }
}

hal::Tube LayOnTable(hal::Tube tube, std::uint64_t seed, double tilt_deg) {
  Random random(seed, 0x706f7365);
  tube.X_WT = {};
  const auto points = SpinePoints(hal::SpineSegments(tube.program, tube.X_WT));
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& point : points) mean += point / static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Vector3d& point : points) spread += (point - mean) * (point - mean).transpose();
  // The direction in which the tube is thinnest goes up or down.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
  const Vector3d thinnest = axes.eigenvectors().col(0) * (random.Chance(0.5) ? 1 : -1);
  const auto lie_down = Eigen::Quaterniond::FromTwoVectors(thinnest, Vector3d::UnitZ());
  const double turn = random.Uniform(0, 2 * std::numbers::pi);
  const double lean_to = random.Uniform(0, 2 * std::numbers::pi);
  const Eigen::AngleAxisd yaw(turn, Vector3d::UnitZ());
  const Eigen::AngleAxisd tilt(random.Uniform(0, tilt_deg * hal::kRadiansPerDegree),
                               Vector3d(std::cos(lean_to), std::sin(lean_to), 0));
  tube.X_WT.orientation =
      (Eigen::Quaterniond(tilt) * Eigen::Quaterniond(yaw) * lie_down).normalized();
  const auto turned = SpinePoints(hal::SpineSegments(tube.program, tube.X_WT));
  tube.X_WT.position_mm = {random.Uniform(200, 600), random.Uniform(-300, 300),
                           tube.pipe_radius_mm - LowestMm(turned, Vector3d::UnitZ())};
  return tube;
}

}  // namespace bendloop::drivers
