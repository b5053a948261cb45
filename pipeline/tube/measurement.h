// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "hal/tube.h"
#include "pipeline/tube/easing.h"
#include "pipeline/tube/flattening.h"
#include "pipeline/tube/joint_uncertainty.h"
#include "pipeline/tube/tube_features.h"

namespace bendloop::pipeline {

// Distances of the samples used from the fitted surface [mm].
struct FitQuality {
  std::size_t samples = 0;   // used by the fit
  std::size_t outliers = 0;  // left out, at any stage
  double median_abs_distance_mm = 0;
  double rms_distance_mm = 0;
  double p95_abs_distance_mm = 0;
};

// A point of the measured spine with the local radius of the pipe.
struct SpineSample {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double pipe_radius_mm = 0;
};

// A scanned point with its signed distance from the fitted surface (outside positive).
struct SurfaceSample {
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double distance_mm = 0;
};

struct StageTime {
  std::string stage;
  double ms = 0;
};

// How far a bend is from round, in its middle.
struct BendShape {
  double ovality_percent = 0;  // (greatest - least diameter) / nominal
  double ovality_sigma_percent = 0;
  double outer_wall_mm = 0;  // how far the outer wall lies inside the round one
  double outer_wall_sigma_mm = 0;
};

// How a bend's curvature begins and ends.
struct BendEasing {
  // Over which the curvature rises, and falls again, evenly; what rises otherwise has the length
  // that moves the spine as much. Its variance is the square over 12.
  double length_mm = 0;
  double length_sigma_mm = 0;
};

// How straight a straight is: the long bends of its spine about its best-fit line, without the
// places beside its bends. Their height: what a straight edge would show, twice over for a bow to
// and fro.
struct StraightForm {
  double height_mm = 0;
  double sigma_mm = 0;
  double length_mm = 0;  // of the part that was looked at; 0: too short to tell
};

// Where the surface is pressed in; hal/tube_features.h says how its place is counted.
struct DentFound {
  double along_mm = 0;    // of the spine, from its start
  double around_deg = 0;  // right-handed about the feed
  double depth_mm = 0;    // below the wall about it, in its middle
  double sigma_mm = 0;    // 1 sigma of the depth
  double size_mm = 0;     // diameter of a circle with the same area
  Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
  double along_sigma_mm = 0, around_sigma_deg = 0;
  double area_mm2 = 0;  // of the surface, where it is at least half as deep as in its middle
  double area_sigma_mm2 = 0;
};

// A weld seam: a ridge all along the tube, at the same angle around, as a bender does not twist it.
struct SeamFound {
  double around_deg = 0;  // on the first straight, from the first bend's normal, as of dents there
  double around_sigma_deg = 0;
  double height_mm = 0;  // above the wall beside it
  double sigma_mm = 0;   // 1 sigma of the height
  double width_mm = 0;   // around, where it is half as high
};

// Wrinkles on the inner side of a bend: waves along it.
struct WrinklesFound {
  std::size_t bend = 0;  // from 0
  double height_mm = 0;  // from crest to trough, on the innermost line
  double sigma_mm = 0;   // 1 sigma of the height
  Eigen::Vector3d middle_mm = Eigen::Vector3d::Zero();  // of the bend
};

// The radius all round the tube at a place near its end.
struct RadiusAt {
  double from_end_mm = 0;  // along the axis, from the end of all into the tube
  double radius_mm = 0;
  double sigma_mm = 0;
};

// What sits on an end, thicker than the tube.
struct EndForm {
  double length_mm = 0;     // from where the plain tube ends to the end of all; 0: nothing
  double outside_mm = 0;    // how far it stands out, at most
  double continues_mm = 0;  // samples too thin for the tube's end go on so far beyond it
  // Where the radius leaves the plain tube's, from the end of all into the tube; 0: nowhere.
  double begins_mm = 0, begins_sigma_mm = 0;
  double returns_mm = 0, returns_sigma_mm = 0;  // of a bead: where it is the plain tube's again
  std::vector<RadiusAt> profile;                // from the end of all on, where it begins

  bool is_bead() const { return returns_sigma_mm > 0; }
  // Only where there is a profile.
  const RadiusAt& Widest() const {
    return *std::max_element(
        profile.begin(), profile.end(),
        [](const RadiusAt& a, const RadiusAt& b) { return a.radius_mm < b.radius_mm; });
  }
};

// By how much a pass of the scan (a turn of the arm, what came after a pause) does not meet the
// others on the tube: what it was moved by for the fit, in the world.
struct PassOffset {
  std::size_t points = 0;
  Eigen::Vector3d move_mm = Eigen::Vector3d::Zero();   // at the tube's middle
  Eigen::Vector3d turn_deg = Eigen::Vector3d::Zero();  // about it
};

// Of Measurement::structure_margin: odds of 150 to 1.
inline constexpr double kCloseCall = 10.0;

// What a scan says of a tube.
struct Measurement {
  hal::Tube tube;          // in the world frame
  hal::BendProgram sigma;  // 1 sigma of every value of tube.program, row by row
  double pipe_radius_sigma_mm = 0;
  JointUncertainty joint;     // which of these values are hardly told apart
  double noise_mm = 0;        // 1 sigma of a sample along the surface normal, from the residuals
  double coverage = 0;        // part of the spine's length that has samples, 0..1
  double longest_gap_mm = 0;  // of the spine without samples
  FitQuality fit;
  std::vector<Flattening> flattening;  // of every bend, as fitted; none: they are round
  std::vector<BendShape> bend_shapes;  // of every bend; none: nothing says that they are not round
  std::vector<BendEasing> bend_easings;  // of every bend; none: nothing says that it is not sharp
  Easing easing;                         // the same, as fitted
  std::vector<StraightForm> straights;   // one more than bends; none: not known, as of canals
  // Of the mean square of the points' distances from this tube: what its straights' bows explain.
  double bows_explain_mm2 = 0;
  std::vector<DentFound> dents;
  std::optional<SeamFound> seam;
  std::vector<WrinklesFound> wrinkles;  // of bends that have some, one after another
  EndForm first_end, last_end;
  TubeFeaturesFound features;
  std::vector<PassOffset> passes;  // none: all points came in one, or in no order that is known
  // By how much the tube is better than the next best one with another number of bends: twice the
  // natural logarithm of the odds. Below kCloseCall it was one; NaN: not known, as of canals.
  double structure_margin = 0;
  // The greatest difference between a row's value in two halves of the samples, in its own sigmas;
  // NaN: not known, as of canals.
  double halves_differ_sigma = 0;
  std::vector<SpineSample> spine;      // along the tube, evenly spaced
  std::vector<SurfaceSample> surface;  // evenly thinned samples, for deviations and pictures
  std::vector<std::string> warnings;   // for a person, one sentence each
  std::vector<StageTime> timing;
};

}  // namespace bendloop::pipeline
