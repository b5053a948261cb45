// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/spoiled_rows.h"

#include <algorithm>
#include <cmath>

#include "drivers/register_bender/field_codec.h"

namespace bendloop::drivers {
namespace {

constexpr double kLongestMm = 50;
constexpr double kLargestDeg = 30;
constexpr int kRowsKept = 4;
constexpr double kAddedDeg = 0.5;

hal::RegisterField InRow(const hal::RegisterMap& map, const hal::ProgramArea& area,
                         hal::RegisterField field, int row) {
  field.address =
      static_cast<std::uint16_t>(area.rows_address + row * map.row_stride + field.address);
  field.space = area.rows_space;
  return field;
}

class Row {
 public:
  Row(const hal::RegisterMap& map, RegisterImage& image) : map_(map), image_(image) {}

  // What does not decode stays as it is.
  template <class Change>
  void Apply(const hal::RegisterField& field, Change change) {
    const auto value = GetField(map_, field, "row", image_);
    if (value) (void)PutField(map_, field, change(*value), "row", image_);
  }
  void Clip(const hal::RegisterField& field, double largest) {
    Apply(field, [largest](double value) { return std::min(value, largest); });
  }
  void Round(const hal::RegisterField& field) {
    Apply(field, [](double value) { return std::round(value); });
  }
  void KeepLowWord(const hal::RegisterField& field) {
    if (field.type != hal::RegisterType::kInt32 && field.type != hal::RegisterType::kUint32) return;
    *(image_.At(field.space, field.address) + (map_.high_word_first ? 0 : 1)) = 0;
  }

 private:
  const hal::RegisterMap& map_;
  RegisterImage& image_;
};

}  // namespace

void SpoilRows(const hal::RegisterMap& map, const hal::ProgramArea& area,
               const RuleMutantSet& mutants, RegisterImage& image) {
  Row row(map, image);
  for (int i = 0; i < map.max_rows; ++i) {
    const auto length = InRow(map, area, map.row_length_mm, i);
    const auto rotation = InRow(map, area, map.row_rotation_deg, i);
    const auto angle = InRow(map, area, map.row_angle_deg, i);
    if (mutants.Has(RuleMutant::kClipsLengths)) row.Clip(length, kLongestMm);
    if (mutants.Has(RuleMutant::kClipsAngles)) row.Clip(angle, kLargestDeg);
    if (mutants.Has(RuleMutant::kRoundsLengths)) row.Round(length);
    if (mutants.Has(RuleMutant::kRoundsRotations)) row.Round(rotation);
    if (mutants.Has(RuleMutant::kRoundsAngles)) row.Round(angle);
    if (mutants.Has(RuleMutant::kKeepsLowWords)) {
      row.KeepLowWord(length);
      row.KeepLowWord(angle);
    }
    if (mutants.Has(RuleMutant::kDropsRows) && i >= kRowsKept) {
      std::fill_n(image.At(area.rows_space,
                           static_cast<std::uint16_t>(area.rows_address + i * map.row_stride)),
                  map.row_stride, std::uint16_t{0});
    }
  }
}

void BendFirstRow(const hal::RegisterMap& map, const hal::ProgramArea& area, RegisterImage& image) {
  const auto angle = InRow(map, area, map.row_angle_deg, 0);
  const auto value = GetField(map, angle, "row", image);
  if (!value) return;
  if (!PutField(map, angle, *value + kAddedDeg, "row", image)) {
    (void)PutField(map, angle, *value - kAddedDeg, "row", image);
  }
}

}  // namespace bendloop::drivers
