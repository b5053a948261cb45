// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/rivals.h"

namespace bendloop::bench {

std::vector<Rival> Rivals() {
  std::vector<Rival> rivals;
#ifdef BENDLOOP_BENCH_CGAL
  rivals.push_back({"CGAL", RunCgal});
#endif
#ifdef BENDLOOP_BENCH_PCL
  rivals.push_back({"PCL", RunPcl});
#endif
  return rivals;
}

}  // namespace bendloop::bench
