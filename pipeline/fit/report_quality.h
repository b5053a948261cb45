// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>

#include "hal/result.h"
#include "pipeline/fit/end_forms.h"
#include "pipeline/fit/registration.h"
#include "pipeline/fit/self_check.h"
#include "pipeline/fit/surface_fit.h"
#include "pipeline/fit/surface_form.h"
#include "pipeline/fit/tube_ends.h"
#include "pipeline/tube/measurement.h"

namespace bendloop::pipeline {

// How sure a result is, and what a person should know of it.

// kBadInput: rough points that hardly tell the pipe's radius are no tube.
hal::Result<void> CheckShowsTube(const SurfaceFit& fit);

// Whether points lie beside the tube place by place, by more than benders leave: it is none of
// lines and arcs, and its wall is not where they have it.
bool LiesOffTogether(const SurfaceFit& fit);

// Shapes of the bends, how decisive the structure is, whether two halves agree, and whether
// there are as many bends as the nominal has, if there is one.
void ReportQuality(const SurfaceFit& structure, const SurfaceFit& fit, const HalvesDiffer& halves,
                   std::optional<std::size_t> nominal_bends, Measurement& measurement);

// The tube with its ends, and the sigmas with those of the ends. An end that no sample shows is
// where the nodes stop, `first_node_mm` and `last_node_mm`, and what it hides makes the bend beside
// it unsure.
void ReportEnds(const SurfaceFit& fit, const TubeEnds& ends, const Eigen::Vector3d& first_node_mm,
                const Eigen::Vector3d& last_node_mm, Measurement& measurement);

// Where something sits on an end (`at_start`: the first), the tube is as long as all of it, and the
// length is no more certain than that; where samples go on, it may be as much longer.
void ReportEndForm(bool at_start, const FoundEnd& found, Measurement& measurement);

// Straightness and dents, and what sides that do not agree leave of the pipe radius.
// `radii_alike`: the bends are of one die.
void ReportForm(const SurfaceForm& form, bool radii_alike, Measurement& measurement);

// Bends that are hardly known to be any. `sides_mm`: how far sides of straights disagree.
void SayUnsureBends(double sides_mm, Measurement& measurement);

// The first bend or the last, where next to nothing lies beyond it: a slight one with hardly any
// samples there, or one with a dent where the tube ends at once. A nominal with as many bends has
// them.
void SayDoubtfulEndBends(const SurfaceFit& fit, std::optional<std::size_t> nominal_bends,
                         Measurement& measurement);

// A dent, as measured, that is too deep for one: what looks so pressed in may be what a bend that
// was not found would have explained.
void SayDeepDents(Measurement& measurement);

// By how much the passes of the scan had to be moved, and whether the tube itself was.
void ReportPasses(const Registration& registration, const PassDrift& drift,
                  Measurement& measurement);

}  // namespace bendloop::pipeline
