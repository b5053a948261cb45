// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace bendloop::pipeline {

// Numbers cells in the order in which they are first met. Open addressing: most questions are about
// cells that hold nothing, and must end at once.
class CellNumbers {
 public:
  std::int32_t Find(const Eigen::Vector3i& cell) const {  // -1: not met
    return slots_[SlotOf(Key(cell))].number;
  }
  std::int32_t FindOrAdd(const Eigen::Vector3i& cell) {  // a new cell's number is count() before
    const std::uint64_t key = Key(cell);
    const std::size_t slot = SlotOf(key);
    if (slots_[slot].number >= 0) return slots_[slot].number;
    const auto number = static_cast<std::int32_t>(count_++);
    slots_[slot] = {key, number};
    if (2 * count_ > slots_.size()) Grow();
    return number;
  }
  std::size_t count() const { return count_; }

 private:
  struct Slot {
    std::uint64_t key = 0;
    std::int32_t number = -1;  // -1: free
  };

  // 21 bits an axis.
  static std::uint64_t Key(const Eigen::Vector3i& cell) {
    const auto part = [](int c) { return static_cast<std::uint64_t>(c + (1 << 20)); };
    return (part(cell.x()) << 42) | (part(cell.y()) << 21) | part(cell.z());
  }
  // Where the key is, or where it would go.
  std::size_t SlotOf(std::uint64_t key) const {
    std::size_t at = (key * 0x9e3779b97f4a7c15u) >> shift_;
    while (slots_[at].number >= 0 && slots_[at].key != key) at = (at + 1) & (slots_.size() - 1);
    return at;
  }
  void Grow() {
    const std::vector<Slot> old = std::exchange(slots_, std::vector<Slot>(2 * slots_.size()));
    --shift_;
    for (const Slot& slot : old) {
      if (slot.number >= 0) slots_[SlotOf(slot.key)] = slot;
    }
  }

  std::vector<Slot> slots_ = std::vector<Slot>(64);  // a power of two, at most half full
  int shift_ = 64 - 6;
  std::size_t count_ = 0;
};

}  // namespace bendloop::pipeline
