// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

#include "hal/error.h"

namespace bendloop::hal {

// What every fallible call of hal, drivers and the loops returns; nothing throws across them.
template <class T>
using Result = tl::expected<T, Error>;

// `return Fail(ErrorKind::kDevice, "...")` from any function that returns a Result.
inline tl::unexpected<Error> Fail(ErrorKind kind, std::string message) {
  return tl::unexpected<Error>(Error{kind, std::move(message)});
}
inline tl::unexpected<Error> Fail(Error error) { return tl::unexpected<Error>(std::move(error)); }

}  // namespace bendloop::hal
