// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <type_traits>
#include <utility>

namespace bendloop::hal {

// Does `last` when its scope is left, by whatever way; `last` must not throw.
template <class Last>
class ScopeExit {
 public:
  static_assert(std::is_nothrow_move_constructible_v<Last>, "or it could be lost on the way");
  explicit ScopeExit(Last last) noexcept : last_(std::move(last)) {}
  ScopeExit(const ScopeExit&) = delete;
  ScopeExit& operator=(const ScopeExit&) = delete;
  ~ScopeExit() { last_(); }

 private:
  Last last_;
};

}  // namespace bendloop::hal
