// SPDX-License-Identifier: Apache-2.0
#include "hal/scope_exit.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace bendloop::hal {
namespace {

TEST(ScopeExit, DoesItOnceAtTheEndWhateverTheWay) {
  int done = 0;
  {
    const ScopeExit last([&] { ++done; });
    EXPECT_EQ(done, 0);
  }
  EXPECT_EQ(done, 1);
  try {
    const ScopeExit last([&] { ++done; });
    throw std::runtime_error("in the middle");
  } catch (const std::runtime_error&) {
    EXPECT_EQ(done, 2);
  }
  EXPECT_EQ(done, 2);
}

}  // namespace
}  // namespace bendloop::hal
