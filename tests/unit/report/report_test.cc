// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/report/report.h"

#include <gmock/gmock.h>

namespace bendloop::host {
TEST(X,Y){}
}
