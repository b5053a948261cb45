// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

#include "hal/bend_program.h"
#include "pipeline/correction/correction_options.h"
#include "pipeline/correction/material.h"
#include "pipeline/tube/joint_uncertainty.h"
#include "tests/support/synthetic_tube.h"

namespace bendloop::support {

// What a random bender is known for among those who work with it.
enum class BenderTemper : std::uint8_t {
  kSteady,
  kDrifting,  // springback, one bend or one length goes the same way, part after part
  kJumping,   // another coil, or a tool that was clamped anew, without a word
  kSlipping,  // a tube slips in its collet now and then
  kRough,     // one and a half to two times the scatter of the others
  kMoody,     // all of these
};
inline constexpr BenderTemper kBenderTempers[] = {BenderTemper::kSteady,  BenderTemper::kDrifting,
                                                  BenderTemper::kJumping, BenderTemper::kSlipping,
                                                  BenderTemper::kRough,   BenderTemper::kMoody};
std::string_view Name(BenderTemper temper);

// What a setter does not know of a bender, drawn at random; tests set single ones.
struct BenderNature {
  double springback_deg = 1.8;  // of every bend
  double springback_part = 0.035;
  double elongation_part = 0.04;
  double backlash_deg = 0;  // of a rotation, half of it to either side, by its direction
  pipeline::PerAxis scatter{0.05, 0.05, 0.05};
  double drift_deg = 0;                             // of the springback, a part
  std::vector<hal::BendRow> errors;                 // of each row: tools, clamps
  std::vector<hal::BendRow> drifts;                 // of the same, a part
  double coil_jumps = 0, row_jumps = 0, slips = 0;  // odds, for each tube
  double coil_jump_deg = 0.8, row_jump = 1.0;       // the least; up to twice that
  double slip = 1.0;                                // mm, degrees; up to twice that
};

// What one tube suffered.
struct TubeFate {
  bool slipped = false;
  bool jumped = false;  // from this one on
};

// A bender, its coil and its scanner, without points: program in, tube out, measurement out.
class LotBender {
 public:
  LotBender(std::uint64_t seed, BenderTemper temper);
  // Of a nature that a test has chosen; nothing is random but scatter and measurement.
  LotBender(std::uint64_t seed, hal::BendProgram nominal, BenderNature nature);

  const hal::BendProgram& nominal() const { return nominal_; }
  // As the cell file has it: roughly right.
  const pipeline::Material& told() const { return told_; }
  const BenderNature& nature() const { return nature_; }
  BenderNature& nature() { return nature_; }
  unsigned overlap() const { return overlap_; }  // tubes between bend and scan
  void set_overlap(unsigned overlap) { overlap_ = overlap; }

  struct Bent {
    hal::BendProgram tube;
    TubeFate fate;
  };
  // The next tube.
  Bent Bend(const hal::BendProgram& program);
  std::uint32_t bent() const { return bent_; }
  // What `program` would be on average as tube `number` (1, 2, ...), by what the bender is since
  // tube `as_of`: 1 or later.
  hal::BendProgram Expected(const hal::BendProgram& program, std::uint32_t number,
                            std::uint32_t as_of) const;
  // From the next tube on.
  void JumpCoil(double springback_deg) { nature_.springback_deg += springback_deg; }
  // The next tube alone: all of its angles are off by so much.
  void SlipNext(double angle_deg) { slip_next_deg_ = angle_deg; }

  struct Scan {
    hal::BendProgram measured;
    hal::BendProgram sigma;
    std::vector<pipeline::Correlation> correlations;
  };
  // Angle and lengths beside a shallow bend go together; now and then an end is hardly seen.
  Scan Measure(const hal::BendProgram& tube);
  double vague_ends = 0.03;  // odds

 private:
  void Draw(BenderTemper temper);
  TubeFate Suffer(hal::BendProgram& tube);
  static hal::BendProgram Expected(const hal::BendProgram& program, const BenderNature& nature,
                                   double number);

  Rng rng_;
  hal::BendProgram nominal_;
  pipeline::Material told_;
  BenderNature nature_;
  std::vector<BenderNature> past_;  // of each tube
  unsigned overlap_ = 0;
  std::uint32_t bent_ = 0;
  double slip_next_deg_ = 0;
};

}  // namespace bendloop::support
