// SPDX-License-Identifier: Apache-2.0
// The paper's overview (Bauer & Polthier 2009, section 1.3): project, connect, simplify,
// approximate, fit. Samples are projected while they arrive; the rest follows when the scan ends,
// and now and then for the live view.
#include "pipeline/reconstruction.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "hal/spine.h"
#include "pipeline/fit/correlations.h"
#include "pipeline/fit/coverage.h"
#include "pipeline/fit/incidence.h"
#include "pipeline/fit/self_check.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/math/text.h"
#include "pipeline/math/workers.h"
#include "pipeline/points/input_checks.h"
#include "pipeline/points/sample_grid.h"
#include "pipeline/spine/mls_projection.h"
#include "pipeline/spine/oriented_samples.h"
#include "pipeline/spine/pipe_radius.h"
#include "pipeline/spine/shrinking.h"
#include "pipeline/spine/spine_polygon.h"
#include "pipeline/spine/tube_choice.h"
#include "pipeline/structure/neighbour_separation.h"
#include "pipeline/structure/structure.h"
#include "pipeline/tube/stage_timer.h"

namespace bendloop::pipeline {
namespace {

// A block is projected when no sample has come to it or its neighbours for this many profiles: the
// laser line has moved on.
constexpr std::uint64_t kQuietProfiles = 12;
constexpr double kFinalReach = 0.2;    // of r_P: what the final fit looks at
constexpr double kShrinkWidest = 1.5;  // a sample's curvature may be so far from the pipe's
constexpr std::size_t kShrinkSamples = 30'000;
constexpr int kMaxParted = 3;          // times that a neighbour is taken off
constexpr double kSettledDeg = 2.0;    // 1 sigma of an angle in the live view
constexpr double kMaxPlaceMm = 1e7;    // no scanner sees further than ten kilometres
constexpr double kCloseCall = 10.0;    // structure_margin
constexpr double kMostMargin = 1e6;    // there may be nothing to compare with
constexpr double kHalvesDiffer = 5.0;  // sigma
constexpr double kVagueRadius = 0.02;  // 1 sigma of r_P over r_P; tubes have less than 0.005
constexpr double kRough = 0.04;        // sigma over r_P; beyond it only noisy wires are

bool IsPlace(const Eigen::Vector3d& point) {
  return (point.array().abs() < kMaxPlaceMm).all();  // NaN is none
}

// Shapes of the bends, margins, and what a person should know of them.
// `as_nominal`: there is one, with so many bends.
void SayHowSure(const SurfaceFit& structure, const SurfaceFit& fit, const HalvesDiffer& halves,
                bool as_nominal, Measurement& measurement) {
  const double r_mm = fit.tube.pipe_radius_mm;
  for (std::size_t i = 0; i < fit.flattening.size(); ++i) {
    const Flattening& f = fit.flattening[i];
    const FlatteningSigma& sigma = fit.flattening_sigma[i];
    measurement.bend_shapes.push_back({100.0 * f.OvalityPart(), 100.0 * sigma.ovality_part,
                                       r_mm * f.OuterWallPart(), r_mm * sigma.outer_wall_part});
  }
  measurement.structure_margin = std::clamp(structure.margin, 0.0, kMostMargin);
  if (measurement.structure_margin < kCloseCall) {
    measurement.warnings.push_back(
        "the number of bends is a close call (margin " + Fixed(measurement.structure_margin, 1) +
        ", clear from 10 on): " +
        (as_nominal ? "it is the nominal's, which the samples alone do not show"
                    : "compare it with the drawing, or scan again with more points"));
  }
  measurement.halves_differ_sigma = halves.sigmas;
  if (halves.sigmas > kHalvesDiffer) {
    measurement.warnings.push_back("two halves of the samples disagree on the " + halves.what +
                                   " (" + Fixed(halves.sigmas, 1) + " sigma): scan again");
  }
}

// An end that no sample shows is where the nodes stop: how far its straight goes on nobody knows.
void EndAtNodes(const TubeEnds& ends, const SpinePolygon& polygon, hal::Tube& tube) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto along = [](const hal::SpineSegment& straight, const SpineNode& node) {
    const double along_mm = (node.position_mm - straight.start_mm).dot(straight.tangent);
    return std::clamp(along_mm, 0.0, straight.length_mm);
  };
  if (!ends.last_seen) {
    tube.program.rows.back().length_mm = along(segments.back(), polygon.back());
  }
  if (!ends.first_seen) {
    const double unseen_mm = along(segments.front(), polygon.front());
    tube.X_WT.position_mm += unseen_mm * segments.front().tangent;
    tube.program.rows.front().length_mm -= unseen_mm;
  }
}

}  // namespace

class Reconstruction::Impl {
 public:
  Impl(const ReconstructionOptions& options, const hal::Clock& clock)
      : options_(options), clock_(clock) {
    if (options.pipe_radius_mm) StartWith(*options.pipe_radius_mm);
  }

  void Add(const hal::LaserProfile& profile) {
    ++profiles_;
    const Eigen::Matrix3d R_WS = profile.X_WS.orientation.toRotationMatrix();
    for (const hal::ProfilePoint& p : profile.points) {
      const Eigen::Vector3d from_sensor = R_WS.col(0) * p.x_mm + R_WS.col(2) * p.z_mm;
      AddPoint(from_sensor + profile.X_WS.position_mm, PackDirection(-from_sensor));
    }
    if (grid_) ProjectQuietBlocks();
  }

  void Add(std::span<const Eigen::Vector3d> points_W) {
    ++profiles_;
    for (const Eigen::Vector3d& p : points_W) AddPoint(p);
  }

  // All at once, and not copied while they wait.
  hal::Result<Measurement> FinishWith(std::span<const Eigen::Vector3d> points_W) {
    ++profiles_;
    if (points_W.size() <= SampleGrid::kMaxPoints &&
        std::all_of(points_W.begin(), points_W.end(), IsPlace)) {
      points_ += points_W.size();
      return Finish(points_W);
    }
    for (const Eigen::Vector3d& p : points_W) AddPoint(p);
    return Finish();
  }

  LiveView View() const;
  // `more`: points that were not added.
  hal::Result<Measurement> Finish(std::span<const Eigen::Vector3d> more = {});

 private:
  void StartWith(double radius_mm) {
    radius_mm_ = radius_mm;
    grid_.emplace(MlsProjection::BlockMm(radius_mm), options_.max_points);
    projection_.emplace(radius_mm);
  }

  void AddPoint(const Eigen::Vector3d& point, SensorDirection to_sensor = {}) {
    ++points_;
    if (!grid_) {
      Wait(point, to_sensor);
      return;
    }
    std::int32_t block = -1;
    if (grid_->Insert(point, block, to_sensor) != SampleGrid::Insertion::kSample) return;
    for (const std::int32_t near : grid_->blocks()[static_cast<std::size_t>(block)].neighbours) {
      if (near >= 0) Touch(static_cast<std::size_t>(near));
    }
  }

  void Wait(const Eigen::Vector3d& point, SensorDirection to_sensor) {
    if (waiting_.size() >= SampleGrid::kMaxPoints || !IsPlace(point)) return;
    if (to_sensor.known() || !waiting_to_sensor_.empty()) {
      waiting_to_sensor_.resize(waiting_.size());
      waiting_to_sensor_.push_back(to_sensor);
    }
    waiting_.push_back(point);
  }

  void Touch(std::size_t block) {
    if (block >= touched_.size()) touched_.resize(block + 1, 0);
    if (touched_[block] == 0) pending_.push_back(static_cast<std::int32_t>(block));
    touched_[block] = profiles_;
  }

  void ProjectQuietBlocks() {
    const auto quiet =
        std::stable_partition(pending_.begin(), pending_.end(), [this](std::int32_t block) {
          return touched_[static_cast<std::size_t>(block)] + kQuietProfiles > profiles_;
        });
    if (quiet == pending_.end()) return;
    Project({quiet, pending_.end()}, nullptr);
    pending_.erase(quiet, pending_.end());
    projection_->UpdateNodes(*grid_);
  }

  void Project(std::span<const std::int32_t> blocks, Workers* workers) {
    for (const std::int32_t block : blocks) touched_[static_cast<std::size_t>(block)] = 0;
    projection_->UpdateBlocks(*grid_, blocks, workers);
  }

  // Blocks whose points may lie on the tube along the polygon; samples only, or all points.
  std::vector<PointBlock> BlocksNear(const SpinePolygon& polygon, bool all_points) const;
  std::vector<SpineNode> FinalNodes(Workers& workers);

  ReconstructionOptions options_;
  const hal::Clock& clock_;
  double radius_mm_ = 0;
  std::vector<Eigen::Vector3d> waiting_;            // until the pipe radius is known
  std::vector<SensorDirection> waiting_to_sensor_;  // of these, or none
  std::optional<SampleGrid> grid_;
  std::optional<MlsProjection> projection_;
  std::vector<std::uint64_t> touched_;  // by block: profile of the last change; 0: up to date
  std::vector<std::int32_t> pending_;
  std::uint64_t profiles_ = 0;
  std::uint64_t points_ = 0;
};

std::vector<PointBlock> Reconstruction::Impl::BlocksNear(const SpinePolygon& polygon,
                                                         bool all_points) const {
  std::vector<Eigen::Vector3d> places;
  const double step_mm = 0.5 * radius_mm_;
  const auto along = [&](const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    const int steps = std::max(1, static_cast<int>(std::ceil((to - from).norm() / step_mm)));
    for (int i = 0; i <= steps; ++i) places.push_back(from + (to - from) * i / steps);
  };
  // Over gaps, and a little beyond the ends, where the projection has too few samples.
  const double beyond_mm = 2.0 * radius_mm_;
  along(polygon.front().position_mm,
        polygon.front().position_mm - beyond_mm * polygon.front().tangent);
  for (std::size_t i = 1; i < polygon.size(); ++i) {
    along(polygon[i - 1].position_mm, polygon[i].position_mm);
  }
  along(polygon.back().position_mm,
        polygon.back().position_mm + beyond_mm * polygon.back().tangent);

  std::vector<PointBlock> result;
  for (const std::int32_t index : grid_->BlocksNear(places, 1.5 * radius_mm_)) {
    if (projection_->IsPlanar(index)) continue;
    const SampleGrid::Block& block = grid_->blocks()[static_cast<std::size_t>(index)];
    PointBlock& out = result.emplace_back();
    out.center_mm = grid_->CenterOf(block);
    out.half_diagonal_mm = 0.5 * std::sqrt(3.0) * grid_->block_mm();
    out.points = all_points ? std::span(block.points) : block.samples();
    if (all_points) out.to_sensor = block.to_sensor;
  }
  return result;
}

std::vector<SpineNode> Reconstruction::Impl::FinalNodes(Workers& workers) {
  if (options_.spine_method == SpineMethod::kShrinking) {
    return ShrinkPipe(OrientSamples(*grid_, radius_mm_, kShrinkWidest, kShrinkSamples),
                      {.radius_mm = radius_mm_})
        .nodes;
  }
  Project(pending_, &workers);
  pending_.clear();
  projection_->FinishNodes(*grid_, &workers);
  return projection_->Nodes();
}

LiveView Reconstruction::Impl::View() const {
  LiveView view;
  view.profiles = profiles_;
  view.points = points_;
  if (!grid_) return view;
  view.pipe_radius_mm = radius_mm_;
  const std::vector<SpineNode> nodes = projection_->Nodes();
  view.spine_samples = nodes.size();
  const std::vector<SpinePolygon> polygons = SpinePolygons(nodes, radius_mm_);
  if (polygons.empty()) return view;
  view.covered_mm = LengthOf(polygons.front());
  const SurfaceFit fit =
      GlanceAtStructure(polygons.front(), radius_mm_, BlocksNear(polygons.front(), false));
  view.program = fit.tube.program;
  view.sigma = fit.sigma;
  // Of a tube still half seen only what is already settled is worth showing.
  for (std::size_t i = 0; i < view.program.bend_count(); ++i) {
    if (view.sigma.rows[i].angle_deg < kSettledDeg) continue;
    view.program.rows.resize(i + 1);
    view.program.rows.back() = {view.program.rows.back().length_mm, 0.0, 0.0, std::nullopt};
    view.sigma.rows.resize(i + 1);
    view.sigma.rows.back() = {view.sigma.rows.back().length_mm, 0.0, 0.0, std::nullopt};
    break;
  }
  return view;
}

hal::Result<Measurement> Reconstruction::Impl::Finish(std::span<const Eigen::Vector3d> more) {
  StageTimer timer(clock_);
  Workers workers(options_.threads);
  Measurement measurement;
  if (!grid_) {
    if (more.empty()) more = waiting_;
    if (const auto shape = CheckShape(more); !shape) return hal::Fail(shape.error());
    const auto radius = EstimatePipeRadius(more, &workers);
    if (!radius) return hal::Fail(radius.error().kind, radius.error().message + kCloserLines);
    if (const auto units = CheckUnits(radius->radius_mm); !units) return hal::Fail(units.error());
    timer.Done("pipe_radius");
    StartWith(radius->radius_mm);
  }
  if (!more.empty()) {
    grid_->InsertAll(more, &workers, waiting_to_sensor_);
    for (std::size_t block = 0; block < grid_->blocks().size(); ++block) Touch(block);
    waiting_ = {};
    waiting_to_sensor_ = {};
  }
  if (grid_->point_count() < kMinPoints) {
    return hal::Fail(hal::ErrorKind::kBadInput,
                     "too few points: found " + std::to_string(grid_->point_count()) +
                         ", a tube needs " + std::to_string(kMinPoints) + " at least");
  }
  timer.Done("samples");

  const std::vector<SpineNode> nodes = FinalNodes(workers);
  timer.Done("projection");

  std::vector<double> left_out_mm;
  auto polygon =
      ChooseTube(SpinePolygons(nodes, radius_mm_), radius_mm_, options_.nominal, left_out_mm);
  if (!polygon) return hal::Fail(polygon.error());
  timer.Done("curve");

  std::vector<PointBlock> blocks = BlocksNear(*polygon, true);
  const auto find_structure = [&] {
    return FindStructure(*polygon, radius_mm_, BlocksNear(*polygon, false), blocks,
                         {.nominal = options_.nominal});
  };
  SurfaceFit structure = find_structure();
  for (int i = 0; i < kMaxParted; ++i) {
    auto pieces = PiecesBetweenJoints(structure, *polygon, i == 0);
    if (pieces.size() == 1 && pieces.front().size() == polygon->size()) break;
    polygon = ChooseTube(std::move(pieces), radius_mm_, options_.nominal, left_out_mm);
    if (!polygon) return hal::Fail(polygon.error());
    blocks = BlocksNear(*polygon, true);
    structure = find_structure();
  }
  SayLeftOut(left_out_mm, measurement.warnings);
  timer.Done("structure");

  const SurfaceFitOptions options{.reach_mm = kFinalReach * structure.tube.pipe_radius_mm,
                                  .max_length_mm = 2.0 * LengthOf(*polygon),
                                  .flattened = !structure.flattening.empty(),
                                  .priors = structure.priors,
                                  .workers = &workers};
  const IncidenceWeights weights = WeighByIncidence(
      structure.tube, structure.flattening, structure.sigma_mm, options.reach_mm, blocks, &workers);
  const SurfaceFit fit = FitSurface(structure.tube, blocks, options);
  const double noise_mm = weights.certainties.empty() ? fit.sigma_mm : weights.noise_mm;
  timer.Done("fit");
  const double r_mm = fit.tube.pipe_radius_mm;
  if (!(fit.pipe_radius_sigma_mm < kVagueRadius * r_mm) && !(fit.sigma_mm < kRough * r_mm)) {
    return hal::Fail(hal::ErrorKind::kBadInput, "no tube: the points lie " + Mm(fit.sigma_mm) +
                                                    " (1 sigma) off one of " + "pipe radius " +
                                                    Mm(r_mm) + " and tell that only to " +
                                                    Mm(fit.pipe_radius_sigma_mm) + kCloserLines);
  }
  const bool as_nominal =
      options_.nominal && options_.nominal->bend_count() == structure.tube.program.bend_count();
  SayHowSure(structure, fit, CompareHalves(fit, blocks, options), as_nominal, measurement);
  timer.Done("self_check");

  const TubeEnds ends = FindTubeEnds(fit.tube, noise_mm, blocks, &workers);
  measurement.tube = ends.tube;
  EndAtNodes(ends, *polygon, measurement.tube);
  measurement.sigma = fit.sigma;
  auto& sigma_rows = measurement.sigma.rows;
  if (sigma_rows.size() == 1) {
    sigma_rows.front().length_mm = std::hypot(ends.first_sigma_mm, ends.last_sigma_mm);
  } else {
    sigma_rows.front().length_mm = std::hypot(sigma_rows.front().length_mm, ends.first_sigma_mm);
    sigma_rows.back().length_mm = std::hypot(sigma_rows.back().length_mm, ends.last_sigma_mm);
  }
  // A bend whose outer straight no sample shows may go on behind what hides it.
  const std::size_t bends = measurement.tube.program.bend_count();
  const auto doubt = [&](std::size_t bend, const char* which) {
    sigma_rows[bend].angle_deg =
        std::max(sigma_rows[bend].angle_deg, 0.5 * measurement.tube.program.rows[bend].angle_deg);
    measurement.warnings.push_back(std::string("no samples on the ") + which +
                                   " straight: the bend beside it may be longer than seen; scan "
                                   "that end again");
  };
  if (bends > 0 && !ends.first_seen) doubt(0, "first");
  if (bends > 0 && !ends.last_seen) doubt(bends - 1, "last");
  measurement.joint = FindCorrelations(fit, measurement.tube.program, measurement.sigma);
  measurement.pipe_radius_sigma_mm = fit.pipe_radius_sigma_mm;
  measurement.noise_mm = noise_mm;
  timer.Done("ends");
  DescribeSamples(blocks, grid_->kept_count(), noise_mm, measurement, &workers);
  timer.Done("description");
  if (const auto units = CheckUnits(measurement.tube.pipe_radius_mm); !units) {
    return hal::Fail(units.error());
  }
  measurement.timing = std::move(timer.times);
  return measurement;
}

Reconstruction::Reconstruction(const ReconstructionOptions& options, const hal::Clock& clock)
    : impl_(std::make_unique<Impl>(options, clock)) {}
Reconstruction::~Reconstruction() = default;
Reconstruction::Reconstruction(Reconstruction&&) noexcept = default;
Reconstruction& Reconstruction::operator=(Reconstruction&&) noexcept = default;

void Reconstruction::Add(const hal::LaserProfile& profile) { impl_->Add(profile); }
void Reconstruction::Add(std::span<const Eigen::Vector3d> points_W) { impl_->Add(points_W); }
LiveView Reconstruction::View() const { return impl_->View(); }
hal::Result<Measurement> Reconstruction::Finish() { return impl_->Finish(); }

hal::Result<Measurement> Reconstruct(std::span<const Eigen::Vector3d> points_W,
                                     const ReconstructionOptions& options,
                                     const hal::Clock& clock) {
  return Reconstruction(options, clock).impl_->FinishWith(points_W);
}

}  // namespace bendloop::pipeline
