// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/structure_score.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "pipeline/fit/place_sums.h"
#include "pipeline/fit/surface_pass.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/cross_matrix.h"
#include "pipeline/math/definite_solver.h"
#include "pipeline/math/dense_product.h"
#include "pipeline/math/dense_solve.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct ScoreSettings {
  // [of r_P] How finely places are told, and pieces of a segment at most.
  double piece = 0.75, most_pieces = 60;
  // [sigma] For the weights: where a bend is missing distances are large, and they are what is
  // looked for.
  double wide_sigmas = 4.0;
  // [mm] A straight of less cannot become shorter.
  double no_length_mm = 1e-6;
  // 1 sigma of how far the parameters may give way: [of r_P] lengths and bend radii, [rad] angles
  // and rotations. Beyond it linear means nothing.
  double range = 0.5, range_rad = 0.1;
  // [of r_P] Nearer to the end of the samples nothing is asked.
  double end = 1.0;
  // [of the largest eigenvalue] A turn that no sample feels; and one that is not asked for, since
  // the samples hardly do.
  double negligible = 1e-9, hardly_felt = 1e-3;
  // [of the scaled diagonal] Keeps the normal equations from being singular.
  double damping = 1e-9;
};
constexpr ScoreSettings kScore;

using Motion = Eigen::Matrix<double, 6, 1>;  // velocity at the origin and angular velocity, world
using MotionMap = Eigen::Matrix<double, 6, 6>;

// From a rigid motion of the world to that of a segment's frame.
MotionMap ToFrame(const hal::SpineSegment& segment, const Eigen::Vector3d& origin) {
  Eigen::Matrix3d frame;
  frame.row(0) = segment.tangent;
  frame.row(1) = segment.normal.cross(segment.tangent);
  frame.row(2) = segment.normal;
  MotionMap map = MotionMap::Zero();
  map.topLeftCorner<3, 3>() = frame;
  map.topRightCorner<3, 3>() = -frame * CrossMatrix(segment.start_mm - origin);
  map.bottomRightCorner<3, 3>() = frame;
  return map;
}

// The samples of a part of a segment, in its frame.
struct TubePiece {
  std::size_t segment = 0;
  double begin_mm = 0;
  SegmentPoints points;
};

std::vector<TubePiece> PiecesOf(const std::vector<hal::SpineSegment>& segments,
                                const SurfaceAssignment& assignment, double pipe_radius_mm) {
  std::vector<TubePiece> pieces;
  for (std::size_t k = 0; k < segments.size(); ++k) {
    const SegmentPoints& points = assignment.segments[k];
    const double length_mm = segments[k].length_mm;
    const double wanted = std::ceil(length_mm / (kScore.piece * pipe_radius_mm));
    const auto count = static_cast<int>(std::clamp(wanted, 1.0, kScore.most_pieces));
    const std::size_t first = pieces.size();
    for (int i = 0; i < count; ++i) {
      pieces.push_back({k, length_mm * i / count, {}});
    }
    for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(points.size); ++i) {
      const double part = length_mm > 0 ? AlongOf(points, i, segments[k]) / length_mm : 0.0;
      const double place = std::clamp(std::floor(part * count), 0.0, count - 1.0);
      pieces[first + static_cast<std::size_t>(place)].points.Add(points, i);
    }
  }
  return pieces;
}

// What a tube may do at a place: a line may turn across itself; an arc also about itself (another
// plane from here on), and a straight may stand in it.
constexpr int kArcModes = 4;
using Modes = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kArcModes>;
// Of a line's two modes the first two: the others are 0, as of modes that no sample feels.
using ModeMatrix = Eigen::Matrix<double, kArcModes, kArcModes>;
using ModeVector = Eigen::Matrix<double, kArcModes, 1>;

Modes ModesAt(const hal::SpineSegment& segment, double along_mm, const Eigen::Vector3d& origin) {
  const Eigen::Vector3d at = segment.PointAt(along_mm);
  const Eigen::Vector3d tangent = segment.TangentAt(along_mm);
  const bool arc = segment.is_arc() && along_mm > 0;
  Modes modes = Modes::Zero(6, arc ? kArcModes : 2);
  modes.col(0).tail<3>() = segment.normal;
  modes.col(1).tail<3>() = segment.normal.cross(tangent);
  if (arc) modes.col(2).tail<3>() = tangent;
  for (Eigen::Index m = 0; m < (arc ? 3 : 2); ++m) {
    modes.col(m).head<3>() = -modes.col(m).tail<3>().cross(at - origin);
  }
  if (arc) modes.col(3) << tangent, Eigen::Vector3d::Zero();
  return modes;
}

// What all pieces from one on say of a common motion of theirs, and of it and the parameters.
struct Suffix {
  MotionMap information = MotionMap::Zero();
  Motion slope = Motion::Zero();
  Eigen::MatrixXd with_parameters;  // 6 x parameters
};

// What may stand at a piece's beginning.
struct BendPlace {
  std::size_t piece;
  Modes modes;
  Eigen::Index column;  // the first of its columns among those of all places
};

// The normal equations of a tube's parameters, in a scale in which they can be solved.
class ScaledEquations {
 public:
  // `scale`: 0 for a parameter that is held.
  ScaledEquations(Eigen::VectorXd scale, const Eigen::MatrixXd& information)
      : scale_(std::move(scale)), solver_(Scaled(scale_, information)) {}
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& right) const {
    return scale_.asDiagonal() * solver_.Solve(scale_.asDiagonal() * right);
  }

 private:
  static Eigen::MatrixXd Scaled(const Eigen::VectorXd& scale, const Eigen::MatrixXd& information) {
    Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
    scaled.diagonal().array() += kScore.damping;
    return scaled;
  }

  Eigen::VectorXd scale_;
  DefiniteSolver solver_;
};

// Where the squared distances are least, of what the samples feel.
ModeVector LeastStep(const ModeMatrix& free, const ModeVector& pull) {
  const ModeVector size = free.diagonal().cwiseMax(1e-30).cwiseSqrt().cwiseInverse();
  const EigenSystem eigen = SymmetricEigen(size.asDiagonal() * free * size.asDiagonal());
  const ModeVector inverse =
      (eigen.values.array() > kScore.hardly_felt)
          .select(eigen.values.cwiseMax(kScore.negligible).cwiseInverse(), 0.0);
  const ModeVector along = eigen.vectors.transpose() * pull.cwiseProduct(size);
  const ModeVector step = eigen.vectors * inverse.cwiseProduct(along);
  return -step.cwiseProduct(size);
}

class MissingBendScore {
 public:
  MissingBendScore(const SurfaceFit& fit, std::span<const PointBlock> blocks, double reach_mm)
      : fit_(fit),
        r_mm_(fit.tube.pipe_radius_mm),
        segments_(hal::SpineSegments(fit.tube.program, fit.tube.X_WT)),
        parameters_(fit.tube, true, fit.flattening),
        origin_(segments_[segments_.size() / 2].start_mm),
        information_(Eigen::MatrixXd::Zero(parameters_.size(), parameters_.size())),
        slope_(Eigen::VectorXd::Zero(parameters_.size())) {
    SumSamples(blocks, reach_mm);
    AddPriors();
  }

  // Place after place.
  std::vector<MissingBend> All() const {
    const ScaledEquations equations(Scale(), information_);
    const Eigen::VectorXd at_rest = equations.Solve(slope_);
    const std::vector<BendPlace> places = Places();
    const Eigen::Index columns =
        places.empty() ? 0 : places.back().column + places.back().modes.cols();
    Eigen::MatrixXd cross(parameters_.size(), columns);
    for (const BendPlace& place : places) {
      cross.middleCols(place.column, place.modes.cols()) =
          TransposeProduct(suffix_[place.piece].with_parameters, place.modes);
    }
    const Eigen::MatrixXd answers = equations.Solve(cross);  // all at once: there may be hundreds
    std::vector<MissingBend> all;
    for (const BendPlace& place : places) {
      const auto of_place = cross.middleCols(place.column, place.modes.cols());
      const Suffix& rest = suffix_[place.piece];
      const Eigen::Index modes = place.modes.cols();
      ModeMatrix free = ModeMatrix::Zero();
      free.topLeftCorner(modes, modes) =
          TransposeProduct(place.modes, Product(rest.information, place.modes)) -
          TransposeProduct(of_place, answers.middleCols(place.column, modes));
      ModeVector pull = ModeVector::Zero();
      pull.head(modes) = place.modes.transpose() * rest.slope - of_place.transpose() * at_rest;
      all.push_back(BendAt(place, free, pull));
    }
    return all;
  }

 private:
  // From the last piece to the first.
  void SumSamples(std::span<const PointBlock> blocks, double reach_mm) {
    const auto derivatives = parameters_.FrameDerivatives(segments_);
    const auto frames = SegmentFrames(segments_, kBeyond * r_mm_, fit_.flattening);
    SurfaceAssignment assignment;
    AssignPoints(frames, r_mm_, blocks, reach_mm, assignment);
    pieces_ = PiecesOf(segments_, assignment, r_mm_);
    const double wide_sigma_mm =
        std::min(kScore.wide_sigmas * fit_.sigma_mm, reach_mm / kFullWeight);
    suffix_.resize(pieces_.size() + 1);
    suffix_.back().with_parameters = Eigen::MatrixXd::Zero(6, parameters_.size());
    CondensedSum of_segment = CondensedSum::Zero();
    for (std::size_t p = pieces_.size(); p-- > 0;) {
      const std::size_t k = pieces_[p].segment;
      const CondensedSum sum = SumOfRows(pieces_[p].points, frames[k], r_mm_, wide_sigma_mm);
      const MotionMap map = ToFrame(segments_[k], origin_);
      suffix_[p].information =
          suffix_[p + 1].information + map.transpose() * sum.topLeftCorner<6, 6>() * map;
      suffix_[p].slope = suffix_[p + 1].slope + map.transpose() * sum.block<6, 1>(0, kLocalState);
      suffix_[p].with_parameters =
          suffix_[p + 1].with_parameters +
          Product(map.transpose() * sum.topLeftCorner<6, kLocalState>(), derivatives[k]);
      of_segment += sum;
      if (p > 0 && pieces_[p - 1].segment == k) continue;
      information_ += TransposeProduct(
          derivatives[k],
          Product(of_segment.topLeftCorner<kLocalState, kLocalState>(), derivatives[k]));
      slope_ += derivatives[k].transpose() * of_segment.block<kLocalState, 1>(0, kLocalState);
      of_segment.setZero();
    }
  }

  // Where the samples leave something open the parameters are believed to be nearly right: what
  // takes them far away, where linear means nothing, is no gain.
  void AddPriors() {
    slope_ = -slope_;
    fit_.priors.Add(parameters_, parameters_.Initial(), fit_.sigma_mm, information_, slope_);
    slope_ = -slope_;
    const auto believe = [this](int i, double range) {
      if (i >= 0) information_(i, i) += fit_.sigma_mm * fit_.sigma_mm / (range * range);
    };
    for (std::size_t i = 0; i < parameters_.bends(); ++i) {
      believe(parameters_.length(i), kScore.range * r_mm_);
      believe(parameters_.rotation(i), kScore.range_rad);
      believe(parameters_.angle(i), kScore.range_rad);
      believe(parameters_.bend_radius(i), kScore.range * r_mm_);
    }
  }

  Eigen::VectorXd Scale() const {
    Eigen::VectorXd scale = information_.diagonal().cwiseSqrt();
    for (double& s : scale) s = s > 0 ? 1.0 / s : 0.0;
    // A straight of nothing cannot become shorter, whatever is asked for.
    for (std::size_t i = 0; i < parameters_.bends(); ++i) {
      const int length = parameters_.length(i);
      const bool is_nothing = fit_.tube.program.rows[i].length_mm < kScore.no_length_mm;
      if (is_nothing && slope_[length] > 0) scale[length] = 0;
    }
    return scale;
  }

  std::vector<BendPlace> Places() const {
    const double total_mm = segments_.back().from_start_mm + segments_.back().length_mm;
    const double margin_mm = kScore.end * r_mm_;
    std::vector<BendPlace> places;
    Eigen::Index columns = 0;
    for (std::size_t p = 1; p < pieces_.size(); ++p) {
      const auto& segment = segments_[pieces_[p].segment];
      const double place_mm = segment.from_start_mm + pieces_[p].begin_mm;
      if (place_mm < margin_mm || place_mm > total_mm - margin_mm) continue;
      places.push_back({p, ModesAt(segment, pieces_[p].begin_mm, origin_), columns});
      columns += places.back().modes.cols();
    }
    return places;
  }

  // `free`, `pull`: information and slope of the modes once the parameters have given way.
  MissingBend BendAt(const BendPlace& place, const ModeMatrix& free, const ModeVector& pull) const {
    const ModeVector step = LeastStep(free, pull);
    const TubePiece& piece = pieces_[place.piece];
    MissingBend bend{piece.segment, piece.begin_mm, Eigen::Vector3d::Zero(), 0, 0};
    const bool arc = place.modes.cols() == kArcModes;
    for (Eigen::Index m = 0; m < (arc ? 3 : 2); ++m)
      bend.turn_rad += step[m] * place.modes.col(m).tail<3>();
    if (arc) bend.stretch_mm = step[3];
    bend.gain = -step.dot(pull) / (fit_.sigma_mm * fit_.sigma_mm * fit_.design_effect);
    return bend;
  }

  const SurfaceFit& fit_;
  double r_mm_;
  std::vector<hal::SpineSegment> segments_;
  TubeParameters parameters_;
  Eigen::Vector3d origin_;
  std::vector<TubePiece> pieces_;
  std::vector<Suffix> suffix_;  // by piece, and one of nothing
  Eigen::MatrixXd information_;
  Eigen::VectorXd slope_;
};

// Those with more gain than their neighbours, the most first.
std::vector<MissingBend> StandingOut(const std::vector<MissingBend>& all) {
  std::vector<MissingBend> standing_out;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool before = i == 0 || all[i].gain >= all[i - 1].gain;
    const bool after = i + 1 == all.size() || all[i].gain > all[i + 1].gain;
    if (before && after) standing_out.push_back(all[i]);
  }
  std::stable_sort(standing_out.begin(), standing_out.end(),
                   [](const auto& a, const auto& b) { return a.gain > b.gain; });
  return standing_out;
}

}  // namespace

std::vector<MissingBend> FindMissingBends(const SurfaceFit& fit, std::span<const PointBlock> blocks,
                                          double reach_mm) {
  return StandingOut(MissingBendScore(fit, blocks, reach_mm).All());
}

}  // namespace bendloop::pipeline
