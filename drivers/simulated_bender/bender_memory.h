// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "drivers/register_bender/register_image.h"
#include "drivers/simulated_bender/rule_mutant.h"
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

  // What a mutant does when so much time has passed; the owner has the clock.
  struct Later {
    std::chrono::milliseconds after;
    std::function<void(BenderMemory&)> deed;
  };

  // The rules that it breaks from now on, none of the others.
  void Break(const RuleMutantSet& mutants);
  // What came up since the last call.
  std::vector<Later> TakeLater();

  // Sets what the bender bends, as an operator at its panel does.
  hal::Result<void> LoadActive(const hal::ProgramBlock& block);
  // Adds to the angle of the first bend, as an operator does (rule R18 of drivers/README.md).
  hal::Result<void> EditActive(double add_deg);
  hal::Result<hal::ProgramBlock> Active() const;
  hal::Result<hal::ProgramBlock> Staged() const;

  // Registers that no field of the map uses do not exist.
  bool CanRead(const RegisterRange& range) const;
  bool CanWrite(const RegisterRange& range) const;

  // To be called after a client has written `range` into image(). True: a commit was asked for,
  // which is a change of its register to another value than 0.
  bool AfterWrite(const RegisterRange& range);
  // Does what the commit register asks: swaps in the staged program or rejects. `forced`, if not
  // kNone, rejects for that reason.
  void HandleCommit(std::uint32_t forced_code);

  // What the PLC says to the cell (fields that are empty stay as they are), and what it was told.
  void Say(const hal::PlcOrders& orders);
  hal::Result<hal::CellReport> Heard() const;
  // False: what is written there is refused.
  void set_takes_report(bool takes) { takes_report_ = takes; }

  void SetState(const hal::BenderState& state);  // active and reply members are ignored
  void ClearVolatile();                          // staging, commit and reply, as at power-up
  void SetActiveRowCount(std::uint32_t rows);    // a lie

  RegisterImage& image() { return image_; }
  const hal::RegisterMap& map() const { return promised_; }
  std::uint32_t accepted() const { return accepted_; }
  std::uint32_t rejected() const { return rejected_; }

 private:
  struct Head {
    std::uint32_t part_number = 0;
    std::uint32_t sequence = 0;
    std::uint32_t row_count = 0;
    std::uint32_t crc = 0;
  };

  bool Breaks(RuleMutant mutant) const { return mutants_.Has(mutant); }
  void After(std::chrono::milliseconds time, std::function<void(BenderMemory&)> deed) {
    later_.push_back({time, std::move(deed)});
  }
  void Put(const hal::RegisterField& field, std::uint32_t value);
  std::uint32_t Get(const hal::RegisterField& field) const;  // 0 if it holds no such number
  std::uint32_t Kept(std::uint32_t sequence) const;          // of a sequence number
  std::uint32_t CrcOf(const hal::ProgramArea& area, const Head& head) const;
  Head HeadOf(const hal::ProgramArea& area) const;
  void CopyRows(std::size_t first, std::size_t end);
  // Copies registers from staging to active, as a PLC does.
  void Activate();
  void UseUp();
  void Decide(std::uint32_t sequence, std::uint32_t forced_code);
  // A commit that passed all checks; false: no mutant does it in its own way.
  bool CommitWrongly(std::uint32_t sequence);
  void Reply(std::uint32_t sequence, RejectCode code);
  RejectCode Judge(std::uint32_t sequence) const;
  bool ValuesFit() const;

  const hal::RegisterMap promised_;  // what clients were told
  hal::RegisterMap map_;             // what it keeps to
  RegisterImage image_;
  std::vector<bool> readable_[2];
  std::vector<bool> writable_;
  hal::BenderMode mode_ = hal::BenderMode::kIdle;
  bool takes_report_ = true;
  std::uint32_t accepted_ = 0;
  std::uint32_t rejected_ = 0;
  std::uint32_t last_commit_ = 0;  // value of the register
  RuleMutantSet mutants_;
  std::vector<Later> later_;
  std::optional<hal::ProgramBlock> older_;  // active before the last commit
};

}  // namespace bendloop::drivers
