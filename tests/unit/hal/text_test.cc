// SPDX-License-Identifier: Apache-2.0
#include "hal/text.h"

#include <gtest/gtest.h>

#include "hal/network_address.h"

namespace bendloop::hal {
namespace {

TEST(Text, IsTrimmedAtBothEndsOnly) {
  EXPECT_EQ(Trimmed(" \t a b\t\r"), "a b");
  EXPECT_EQ(Trimmed("\r \t"), "");
  EXPECT_EQ(Trimmed(""), "");
  EXPECT_EQ(Trimmed("a\n"), "a\n");
}

TEST(Text, IsLoweredWithoutALocale) {
  EXPECT_EQ(Lower("AZaz09[@`{"), "azaz09[@`{");
  EXPECT_EQ(Lower("\xc3\x84"), "\xc3\x84");  // an umlaut stays
}

TEST(NetworkAddress, IsNumericInDigitsOnly) {
  for (const char* good : {"127.0.0.1", "192.168.10.20", "::1", "fe80::1"}) {
    EXPECT_TRUE(IsNumericAddress(good)) << good;
  }
  for (const char* bad :
       {"", "localhost", "192.168.10", "192.168.10.256", "192.168.1.1:502", "::g"}) {
    EXPECT_FALSE(IsNumericAddress(bad)) << bad;
  }
}

}  // namespace
}  // namespace bendloop::hal
