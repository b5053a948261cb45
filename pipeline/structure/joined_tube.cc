// SPDX-License-Identifier: Apache-2.0
#include "pipeline/structure/joined_tube.h"

#include <Eigen/Dense>
#include <limits>
#include <vector>

#include "hal/spine.h"
#include "pipeline/fit/normal_equations.h"
#include "pipeline/fit/tube_parameters.h"
#include "pipeline/math/definite_solver.h"
#include "pipeline/spline/arc_line_spline.h"

namespace bendloop::pipeline {
namespace {

// By trial where nothing else is said.
struct JoinSettings {
  // [of r_P] A tube no further beside the spline is as good a start for a fit.
  double near = 0.05;
  // Gauss-Newton steps; [of the scaled diagonal] what keeps lengths and angles that the places
  // hardly tell where they are.
  int most_steps = 8;
  double damping = 1e-4;
};
constexpr JoinSettings kJoin;

// Where the spline's arcs begin and end, and the spline itself.
std::vector<Eigen::Vector3d> PlacesOf(const ArcLineSpline& spline) {
  std::vector<Eigen::Vector3d> places;
  for (const SplineArc& arc : spline.arcs) {
    places.push_back(arc.begin_mm);
    places.push_back(arc.end_mm);
  }
  places.push_back(spline.end_mm);
  return places;
}

// How far a tube's places lie beside these, and how its parameters move them.
struct Beside {
  Eigen::VectorXd off_mm;
  Eigen::MatrixXd derivative;
  double squares_mm2() const { return off_mm.squaredNorm(); }
};

Beside BesideOf(const hal::Tube& tube, const TubeParameters& parameters,
                const std::vector<Eigen::Vector3d>& places) {
  const auto segments = hal::SpineSegments(tube.program, tube.X_WT);
  const auto derivatives = parameters.FrameDerivatives(segments);
  const auto count = static_cast<Eigen::Index>(places.size());
  Beside beside{Eigen::VectorXd(3 * count), Eigen::MatrixXd(3 * count, parameters.size())};
  for (Eigen::Index i = 0; i + 1 < count; ++i) {
    const auto k = static_cast<std::size_t>(i) + 1;  // the segment that begins there
    beside.off_mm.segment<3>(3 * i) = segments[k].start_mm - places[k - 1];
    beside.derivative.middleRows<3>(3 * i) = segments[k].axes() * derivatives[k].topRows<3>();
  }
  // Where the last straight stops nothing says: only beside it there is no spline.
  const hal::SpineSegment& last = segments.back();
  const Eigen::Vector3d end = last.PointAt(last.length_mm);
  const Eigen::Matrix3d axes = last.axes();
  Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - last.tangent * last.tangent.transpose();
  Eigen::Matrix3d arm = Eigen::Matrix3d::Zero();  // of a turn about the start: z and y move the end
  arm(1, 2) = last.length_mm;
  arm(2, 1) = -last.length_mm;
  beside.off_mm.tail<3>() = across * (end - places.back());
  beside.derivative.bottomRows<3>() =
      across * axes * (derivatives.back().topRows<3>() + arm * derivatives.back().middleRows<3>(3));
  return beside;
}

}  // namespace

hal::Tube JoinedTube(const ArcLineSpline& spline, double pipe_radius_mm) {
  hal::Tube tube = TubeFromSpline(spline, pipe_radius_mm);
  const std::vector<Eigen::Vector3d> places = PlacesOf(spline);
  for (int i = 0; i < kJoin.most_steps; ++i) {
    const TubeParameters parameters(tube, false);
    const Beside beside = BesideOf(tube, parameters, places);
    if (beside.off_mm.cwiseAbs().maxCoeff() < kJoin.near * pipe_radius_mm) break;
    Eigen::MatrixXd matrix = beside.derivative.transpose() * beside.derivative;
    const Eigen::VectorXd diagonal = matrix.diagonal();
    matrix.diagonal() +=
        kJoin.damping * diagonal + Eigen::VectorXd::Constant(diagonal.size(), 1e-9);
    const DefiniteSolver solver(matrix);
    if (!solver.is_definite()) break;
    const FitBounds bounds(parameters, pipe_radius_mm, std::numeric_limits<double>::max());
    const Eigen::VectorXd at = parameters.Initial();
    const Eigen::VectorXd step = solver.Solve(beside.derivative.transpose() * beside.off_mm);
    const hal::Tube next = parameters.TubeAt(bounds.Inside(at - step));
    const double squares_mm2 = BesideOf(next, TubeParameters(next, false), places).squares_mm2();
    if (!(squares_mm2 < beside.squares_mm2())) break;
    tube = next;
  }
  return tube;
}

}  // namespace bendloop::pipeline
