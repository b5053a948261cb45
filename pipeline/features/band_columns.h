// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "pipeline/features/end_border.h"
#include "pipeline/features/end_sectors.h"

namespace bendloop::pipeline {

// A sample about the border: 1, cosine and sine of its place around.
struct BorderSample {
  Eigen::Vector3d row = Eigen::Vector3d::UnitX();
  double at_mm = 0;
};

// The samples about an end, in columns of the turn: those about its border, and those behind it,
// which tell how many there are.
class BandColumns {
 public:
  // `plane_mm`: about which the border lies within `band_mm`; behind that samples are taken from
  // `deep_mm`. `hidden`: sectors that are not looked at.
  BandColumns(std::span<const BandSample> samples, const Eigen::Vector3d& plane_mm,
              const EndSectors& hidden, double band_mm, double deep_mm);

  // Whether their number in small cells differs as that of scattered ones does.
  bool AreScattered(double smear_mm) const;
  // How much of their density may be another at the border than behind it: as much as it changes
  // from the farther half of them to the nearer one, and on to the border.
  double DensityDoubt() const;
  // The samples about the border, and what is missing beyond it. None: much of the turn is hidden.
  std::optional<std::vector<BorderSample>> Seen(double spread_mm, Eigen::Vector3d& missing) const;

 private:
  // Cells of how many samples, in parts of the turn, and how much their numbers may differ.
  struct Cells {
    std::size_t sectors;
    double in_cell, least_ring_mm, most_scatter;
  };
  bool AreScatteredIn(const Cells& in) const;
  double Deep(std::size_t k) const { return static_cast<double>(deep_[k].size()); }
  bool IsHidden(std::size_t k) const;

  double band_mm_, deep_mm_;
  EndSectors hidden_;
  std::vector<std::vector<double>> deep_;  // [mm] before the band
  std::vector<std::vector<BorderSample>> near_;
};

}  // namespace bendloop::pipeline
