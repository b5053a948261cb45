// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/cad/occt/placements.h"

#include <StepGeom_CartesianTransformationOperator3d.hxx>
#include <StepGeom_Direction.hxx>
#include <StepRepr_MappedItem.hxx>
#include <StepRepr_Representation.hxx>
#include <StepRepr_RepresentationMap.hxx>
#include <StepShape_ShapeRepresentation.hxx>
#include <cmath>
#include <gp_Vec.hxx>

namespace bendloop::cad {
namespace {

// `otherwise` where the file leaves the direction out.
gp_Vec VectorOf(const Handle(StepGeom_Direction) & direction, const gp_Vec& otherwise) {
  if (direction.IsNull() || direction->NbDirectionRatios() < 3) return otherwise;
  return {direction->DirectionRatiosValue(1), direction->DirectionRatiosValue(2),
          direction->DirectionRatiosValue(3)};
}

bool Mirrors(const StepGeom_CartesianTransformationOperator3d& by) {
  const gp_Vec x = VectorOf(by.Axis1(), {1, 0, 0}), y = VectorOf(by.Axis2(), {0, 1, 0});
  const gp_Vec across = x.Crossed(y);
  return across.Dot(VectorOf(by.Axis3(), across)) < 0;
}

bool PlacesShape(const StepRepr_MappedItem& item) {
  const Handle(StepRepr_RepresentationMap) source = item.MappingSource();
  return !source.IsNull() && !source->MappedRepresentation().IsNull() &&
         source->MappedRepresentation()->IsKind(STANDARD_TYPE(StepShape_ShapeRepresentation));
}

}  // namespace

std::string PlacementNotTaken(const Handle(StepData_StepModel) & model) {
  for (int i = 1; i <= model->NbEntities(); ++i) {
    const auto item = Handle(StepRepr_MappedItem)::DownCast(model->Value(i));
    if (item.IsNull() || !PlacesShape(*item)) continue;
    const auto by =
        Handle(StepGeom_CartesianTransformationOperator3d)::DownCast(item->MappingTarget());
    if (by.IsNull()) continue;
    const bool scales = by->HasScale() && std::abs(by->Scale() - 1) > 1e-9;
    const bool mirrors = Mirrors(*by);
    if (!scales && !mirrors) continue;
    return std::string("#") + std::to_string(model->IdentLabel(by)) +
           (mirrors ? " mirrors" : " scales");
  }
  return "";
}

}  // namespace bendloop::cad
