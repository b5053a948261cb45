// SPDX-License-Identifier: Apache-2.0
#include "hal/network_address.h"

#include <arpa/inet.h>

namespace bendloop::hal {

bool IsNumericAddress(const std::string& host) {
  unsigned char address[sizeof(in6_addr)];
  return inet_pton(AF_INET, host.c_str(), address) == 1 ||
         inet_pton(AF_INET6, host.c_str(), address) == 1;
}

}  // namespace bendloop::hal
