// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <string>

#include "hal/result.h"

namespace bendloop::pipeline {

// Fewer are no tube.
inline constexpr std::size_t kMinPoints = 30;

// What helps where hardly anything was found.
inline constexpr const char* kCloserLines =
    "; if the laser lines are farther apart than half the pipe radius, scan with closer ones";

// No scanner sees further than ten kilometres; what is no number is nowhere.
bool IsPlace(const Eigen::Vector3d& point_mm);

// "4.002 mm".
std::string Mm(double value);

// kBadInput: what the points look like when they are no tube.
hal::Result<void> CheckShape(std::span<const Eigen::Vector3d> points);

// kBadInput: no bending machine takes such a pipe, so the units are wrong.
hal::Result<void> CheckUnits(double radius_mm);

}  // namespace bendloop::pipeline
