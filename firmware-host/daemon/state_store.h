// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "hal/result.h"
#include "pipeline/correction/correction.h"

namespace bendloop::host {

// Of a part's lot in a state directory: 0 for the cell file's own part, else the part's number.
inline std::uint32_t LotFileOf(std::uint32_t part_number, std::uint32_t own_part_number) {
  return part_number == own_part_number ? 0 : part_number;
}

// Who opens a state directory.
enum class StateUser : std::uint8_t {
  kCell,        // whoever measures and corrects
  kAcceptance,  // the robot that tries the bender's PLC
};

// The state directory: what outlives the process. Held by one process at a time.
//   lock               taken while a daemon, or a replay on the real bender, runs
//   journal.db         every program on its way to the bender, every tube bent, every scan's fate
//   acceptance.json    the program that an acceptance run must put back, while it runs
//   history.db         every part
//   lot.json           what the lot has taught so far; of parts that the PLC sets besides the cell
//                      file's own: lot-NUMBER.json
//   status.json        where the running daemon answers
//   status.sock        it answers there too, its user and group
//   requests/          what commands ask the running daemon (setter_box.h)
//   requests.log       who asked for what, and what became of it
//   results/NAME.json  one a part
//   sessions/          recordings, unless the cell file says otherwise
class StateStore {
 public:
  // Creates the directory and takes the lock. kDevice when it cannot be written or is taken; for
  // the cell also when an acceptance run was cut, because the bender may hold a program of its.
  static hal::Result<StateStore> Open(const std::filesystem::path& directory,
                                      StateUser user = StateUser::kCell);
  StateStore(StateStore&& other) noexcept;
  StateStore& operator=(StateStore&&) = delete;
  ~StateStore();

  std::filesystem::path journal() const { return directory_ / "journal.db"; }
  std::filesystem::path acceptance() const { return directory_ / "acceptance.json"; }
  std::filesystem::path history() const { return directory_ / "history.db"; }
  std::filesystem::path status() const { return directory_ / "status.json"; }
  std::filesystem::path socket() const { return directory_ / "status.sock"; }
  // Who asked for what, a JSON line each (setter_desk.h).
  std::filesystem::path requests_log() const { return directory_ / "requests.log"; }
  const std::filesystem::path& directory() const { return directory_; }
  std::filesystem::path results() const { return directory_ / "results"; }
  std::filesystem::path report() const { return directory_ / "report.html"; }

  // 7 when "part-0007" is the last one in results/ and `sessions`.
  unsigned LastNumber(const std::filesystem::path& sessions) const;

  // `key` names the settings that the lot was learnt with; another key begins a new lot. A damaged
  // file is an error: deciding without what is known would be a jump in the corrections. `part`:
  // as LotFileOf.
  hal::Result<std::optional<pipeline::LotState>> Lot(std::string_view key,
                                                     std::uint32_t part = 0) const;
  bool HasLot(std::uint32_t part = 0) const;
  hal::Result<void> KeepLot(const pipeline::LotState& lot, std::string_view key,
                            std::uint32_t part = 0) const;

 private:
  StateStore(std::filesystem::path directory, int lock)
      : directory_(std::move(directory)), lock_(lock) {}
  std::filesystem::path directory_;
  int lock_ = -1;
};

// The lot of a state directory that another process may hold; as StateStore::Lot.
hal::Result<std::optional<pipeline::LotState>> ReadLotOf(const std::filesystem::path& directory,
                                                         std::string_view key,
                                                         std::uint32_t part = 0);

// "part-0007".
std::string PartName(unsigned number);
// And back: 7 of "part-0007" and of "part-0007.json"; 0 for other names.
unsigned NumberInName(const std::string& name);

}  // namespace bendloop::host
