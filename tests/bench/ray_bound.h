// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "hal/tube_features.h"
#include "tests/bench/cut_scan.h"

namespace bendloop::bench {

// The least error that a scan by laser lines lets a border have: of whoever knows the round tube,
// every ray of the scan exactly, where its sample lies along the wall to half the noise, and how
// often the scanner loses a spot that lies on the wall and beside it (mixed_pixel_fraction): such a
// ray is taken for one that met none. All borders are as likely as they make such a scan; their
// mean is the best estimate (Pitman), and their spread, 1 sigma of each number, is this. No number
// of samples makes an unbiased error smaller that treats all places alike. Not knowing where those
// rays went that met nothing comes on top.

// Of an opening: along and around [mm], width; of a slot length and axis [radians] too. Empty: no
// ray tells of it.
Eigen::VectorXd RayBound(const CutScan& scanned, const hal::WallOpening& opening);
// Of an end: its place at the axis [mm], and its slope in either direction.
Eigen::Vector3d RayBound(const CutScan& scanned, bool at_start);

}  // namespace bendloop::bench
