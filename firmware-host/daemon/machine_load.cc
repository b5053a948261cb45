// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/machine_load.h"

#include <sys/resource.h>
#include <sys/sysinfo.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <string>
#include <thread>

namespace bendloop::host {
namespace {

double Seconds(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

// "VmSwap:	     128 kB" of its own status.
std::uint64_t OwnSwappedBytes() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    unsigned long long kb = 0;
    if (std::sscanf(line.c_str(), "VmSwap: %llu kB", &kb) == 1) return kb << 10;
  }
  return 0;
}

}  // namespace

MachineLoad LookAtMachine() {
  MachineLoad load;
  load.processors = std::max(1u, std::thread::hardware_concurrency());
  rusage own{};
  getrusage(RUSAGE_SELF, &own);
  load.own_cpu_s = Seconds(own.ru_utime) + Seconds(own.ru_stime);
  struct sysinfo info {};
  if (sysinfo(&info) != 0) return load;
  load.wanted = static_cast<double>(info.loads[0]) / (1 << SI_LOAD_SHIFT);
  load.swapped_bytes = static_cast<std::uint64_t>(info.totalswap - info.freeswap) * info.mem_unit;
  if (load.swapped_bytes > 0) load.own_swapped_bytes = OwnSwappedBytes();
  return load;
}

}  // namespace bendloop::host
