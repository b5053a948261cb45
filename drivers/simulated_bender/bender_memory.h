// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "hal/bend_program.h"
#include "hal/bender_state.h"
#include "hal/register_map.h"
#include "hal/result.h"

namespace bendloop::drivers {

// Why the simulated bender rejects a commit: the value of reply_code.
enum class RejectCode : std::uint32_t {
  kNone = 0,
  kCrc = 1,        // the staged crc is not that of the staged rows
  kSequence = 2,   // the sequence written to commit is not the staged one
  kRowCount = 3,   // 0, or more than the bender has
  kValue = 4,      // a length below 0, an angle below 0 or of 360 and more, an end with an angle
  kNotIdle = 5,    // bending, not ready or in fault
  kNotNew = 6,     // the sequence is the active one already
  kOtherPart = 7,  // another part is set up
};

// A PLC's registers and its side of the handshake, without network or clock.
class BenderMemory {
 public:
  // The map must have passed CheckRegisterMap.
  explicit BenderMemory(hal::RegisterMap map);

  // Sets what the bender bends, as an operator at its panel does.
  hal::Result<void> LoadActive(const hal::ProgramBlock& block);
  hal::Result<hal::ProgramBlock> Active() const;
  hal::Result<hal::ProgramBlock> Staged() const;

  // Registers that no field of the map uses do not exist.
  bool CanRead(const RegisterRange& range) const;
  bool CanWrite(const RegisterRange& range) const;

  // To be called after a client has written `range` into image(). True: a commit was asked for.
  bool AfterWrite(const RegisterRange& range);
  // Does what the commit register asks: swaps in the staged program or rejects. `forced`, if not
  // kNone, rejects for that reason.
  void HandleCommit(std::uint32_t forced_code);

  void SetState(const hal::BenderState& state);  // active and reply members are ignored
  void ClearVolatile();                          // staging, commit and reply, as after power-up
  void SetActiveRowCount(std::uint32_t rows);    // a lie

  RegisterImage& image() { return image_; }
  const hal::RegisterMap& map() const { return map_; }
  std::uint32_t accepted() const { return accepted_; }
  std::uint32_t rejected() const { return rejected_; }

 private:
  void Put(const hal::RegisterField& field, std::uint32_t value);
  void Activate(const hal::ProgramBlock& staged);  // copies registers, as a PLC does
  void Reply(std::uint32_t sequence, RejectCode code);
  RejectCode Judge(std::uint32_t sequence, hal::ProgramBlock& staged) const;

  hal::RegisterMap map_;
  RegisterImage image_;
  std::vector<bool> readable_[2];
  std::vector<bool> writable_;
  hal::BenderMode mode_ = hal::BenderMode::kIdle;
  std::uint32_t accepted_ = 0;
  std::uint32_t rejected_ = 0;
};

}  // namespace bendloop::drivers
