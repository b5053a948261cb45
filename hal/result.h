// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nonstd/expected.hpp>
#include <utility>

#include "hal/error.h"

namespace bendloop::hal {

// What every fallible call of hal, drivers and the loops returns; nothing throws across them.
template <class T>
using Result = nonstd::expected<T, Error>;

// `return Fail(ErrorKind::kDevice, "...")` from any function that returns a Result.
inline nonstd::unexpected_type<Error> Fail(ErrorKind kind, std::string message) {
  return nonstd::make_unexpected(Error{kind, std::move(message)});
}
inline nonstd::unexpected_type<Error> Fail(Error error) {
  return nonstd::make_unexpected(std::move(error));
}

}  // namespace bendloop::hal
