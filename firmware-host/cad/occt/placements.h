// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <StepData_StepModel.hxx>
#include <string>

namespace bendloop::cad {

// A placement of `model` that mirrors or scales a shape, as "#12 mirrors"; empty: none does.
// OpenCASCADE takes their shift and turn alone and says nothing: a left-hand part would come out as
// the right-hand one.
std::string PlacementNotTaken(const Handle(StepData_StepModel) & model);

}  // namespace bendloop::cad
