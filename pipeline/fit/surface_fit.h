// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <span>
#include <vector>

#include "hal/tube.h"
#include "pipeline/fit/dent_margin.h"
#include "pipeline/fit/fit_priors.h"
#include "pipeline/fit/form_deviation.h"
#include "pipeline/fit/surface_points.h"
#include "pipeline/math/workers.h"

namespace bendloop::pipeline {

// So many points are fitted at once; of more the fit keeps no distances.
constexpr std::size_t kPointsAtOnce = 40'000;

// What is asked of a fit of few points: the tube alone, that and what it costs (of few points with
// their distances and the design effect), or everything. Less costs less.
enum class FitReport { kTube, kCost, kAll };

struct SurfaceFitOptions {
  // Points further than this from the surface are never looked at [mm].
  double reach_mm = 0;
  // The least standard deviation that is believed [mm]: keeps noise-free data from rejecting all.
  double min_sigma_mm = 1e-4;
  bool free_pipe_radius = true;
  double max_length_mm = 1e6;  // of a straight
  // Of the first and the last straight so much lies beyond the points on it, hidden by what sits on
  // the end. Its best-fit line is of all of it.
  std::array<double, 2> hidden_mm{0, 0};
  bool flattened = false;         // the bends need not be round
  bool wide_plateau = false;      // where their outer walls sink in
  SectionRise section_rise = {};  // of their oval and their outer walls
  DentMargin dents = {};          // left out
  Easing easing = {};             // to begin with; none: the bends are sharp
  FitPriors priors = {};
  // [of what the design effect is beyond 1] Added to it for the covariance. What moves places
  // together is a few displacements more often than many, and what so few tell of their spread is
  // less than it looks: Student's t has a greater variance than a normal.
  double few_causes = 0.0;
  FormDeviation form = {};  // what samples are worth where structures are compared
  int max_steps = 40;       // of Levenberg-Marquardt
  // A step that makes chi square less by no more than this part is the last.
  double tolerance = 0;
  // A fit of few points that will not come down to this `cost_mm2` at its present pace is given up.
  double goal_mm2 = std::numeric_limits<double>::infinity();
  FitReport report = FitReport::kAll;
  Workers* workers = nullptr;  // for very many points
};

struct SurfaceFit {
  hal::Tube tube;
  hal::BendProgram sigma;  // 1 sigma, from the covariance; first and last length: fit part only
  double pipe_radius_sigma_mm = 0;
  Eigen::MatrixXd covariance;          // of all TubeParameters (mm, rad), `design_effect` included
  Eigen::VectorXd last_start;          // derivative of where the last straight begins, along it
  FitPriors priors;                    // as given
  std::vector<Flattening> flattening;  // of every bend; none: they are round
  std::vector<FlatteningSigma> flattening_sigma;
  Easing easing;                         // none: the bends are sharp
  std::vector<double> easing_sigma_mm2;  // the same
  double sigma_mm = 0;                   // robust standard deviation of the distances
  // Variance of block means over that of independent samples, at least 1; `sigma` includes it, but
  // for `turn_surplus`.
  double design_effect = 1;
  double direction_effect = 1;  // the same of directions, DesignEffect::OfDirections()
  double sides_mm2 = 0;         // DesignEffect::SidesMm2()
  // [rad^2] Of rotations and angles, by parameter: what `covariance` has of them beyond that.
  Eigen::VectorXd turn_surplus;
  // Of a sample, where structures are compared: that of the distances with the design effect, or
  // what the form of real tubes leaves of it, whichever is more.
  double variance_mm2 = 0;
  double form_mm = 0;                // how far the form of real tubes moves a place across
  std::vector<double> distances_mm;  // of the points within reach, if they are few
  std::vector<double> segment_mean_square_mm2;  // of min(d, reach): line, arc, ..., line
  std::vector<double> segment_samples;          // near line, arc, ..., line
  std::vector<double> segment_used;             // of these, with weight
  std::size_t used = 0;                         // points with weight
  std::size_t points = 0;                       // all points looked at
  double cost_mm2 = 0;                          // sum of squares, bounded for what is far off
  double start_cost_mm2 = 0;                    // the same where it began, if the points are few
  double margin = 0;                            // see Measurement::structure_margin
  std::optional<hal::Tube> rival = {};          // the next best by that margin, if it is known
  Eigen::MatrixXd information;                  // normal matrix of all TubeParameters
  double residual_mm2 = 0;                      // variance of the distances with weight
  double occam_penalty = 0;                     // FitPriors::OccamPenalty()
  bool converged = false;
};

// What the samples of a fit are worth where the tube's form is this (`variance_mm2`, `form_mm`).
void SetForm(const FormDeviation& form, SurfaceFit& fit);
// The same with the penalty of its numbers: as if it had been fitted with this form.
void AssumeForm(const FormDeviation& form, bool free_pipe_radius, SurfaceFit& fit);

// Adds what else is unknown of the parameters of lines and arcs to the fit's covariance and sigmas.
void Widen(const Eigen::MatrixXd& covariance, bool free_pipe_radius, SurfaceFit& fit);

// The covariance of all TubeParameters, and the sigmas that follow from it.
void SetCovariance(Eigen::MatrixXd covariance, bool free_pipe_radius, SurfaceFit& fit);

// Least squares of the orthogonal distance of the tube's surface from the points, in the LRA
// parameters (start pose across the first tangent, lengths, rotations, angles, bend radii, pipe
// radius, flattening and easing of the bends) by Levenberg-Marquardt with analytic Jacobians and
// weights that fade out beyond 3.5 sigma. First and last length are not determined by distances and
// stay as they are. Source: Bauer & Polthier 2009, section 6; the parametrisation of section 5.3.
SurfaceFit FitSurface(const hal::Tube& start, std::span<const PointBlock> blocks,
                      const SurfaceFitOptions& options);

}  // namespace bendloop::pipeline
