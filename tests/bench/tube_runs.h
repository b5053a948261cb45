// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace bendloop::bench {

// Which random tubes a benchmark goes through, and how many at a time.
struct TubeRuns {
  std::uint64_t tubes;
  std::uint64_t seed = 1;
  unsigned threads = std::thread::hardware_concurrency();

  std::uint64_t first_seed() const { return seed * 1'000'000; }

  void AddOptions(CLI::App& app) {
    app.add_option("--tubes", tubes, "How many")
        ->check(CLI::Range(1, 1000000))
        ->capture_default_str();
    app.add_option("--seed", seed, "Tubes from this seed times a million on")
        ->check(CLI::Range(0, 1000000000))
        ->capture_default_str();
    app.add_option("--threads", threads, "Tubes at a time")
        ->check(CLI::Range(1, 256))
        ->capture_default_str();
  }
};

// What `run` makes of each seed, in their order.
template <class Result, class Run>
std::vector<Result> RunSeeds(const std::vector<std::uint64_t>& seeds, unsigned threads, Run run) {
  std::vector<Result> results(seeds.size());
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < results.size(); i = next++) results[i] = run(seeds[i]);
  };
  std::vector<std::thread> workers;
  for (unsigned i = 1; i < threads; ++i) workers.emplace_back(work);
  work();
  for (std::thread& worker : workers) worker.join();
  return results;
}

}  // namespace bendloop::bench
