// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/load/load_soak.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "tests/bench/bench_table.h"

namespace bendloop::bench {
namespace {

constexpr std::size_t kReports = 25;  // the daemon keeps 20 results for its report

double Mean(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

// Least squares over the part's number; needs three values behind the warm-up.
void AddDrift(std::vector<Drift>& drifts, const std::string& what, const std::string& unit,
              const std::vector<double>& all, double matters) {
  const std::size_t from = WarmParts(all.size());
  if (all.size() < from + 3) return;
  const std::span<const double> values = std::span(all).subspan(from);
  const auto n = static_cast<double>(values.size());
  const double mean = Mean(values);
  double xx = 0, xy = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double x = static_cast<double>(i) - 0.5 * (n - 1);
    xx += x * x;
    xy += x * (values[i] - mean);
  }
  const double slope = xy / xx;
  double rest = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double x = static_cast<double>(i) - 0.5 * (n - 1);
    rest += std::pow(values[i] - mean - slope * x, 2);
  }
  const double sigma = std::sqrt(rest / (n - 2) / xx);
  const std::size_t tenth = std::max<std::size_t>(1, values.size() / 10);
  const bool drifts_away = std::abs(slope) * n > matters && std::abs(slope) > 3 * sigma;
  drifts.push_back({what, unit, Mean(values.first(tenth)), Mean(values.last(tenth)), 1000 * slope,
                    1000 * sigma, matters, drifts_away});
}

// Four digits behind the point, as small drifts need them, signed.
std::string Fine(double value) {
  char text[32];
  std::snprintf(text, sizeof text, std::abs(value) < 10 ? "%+.4f" : "%+.2f", value);
  return text;
}

}  // namespace

std::size_t WarmParts(std::size_t parts) {
  return std::min(std::max(parts / 10, kReports), parts / 2);
}

std::vector<Drift> Drifts(const LoadResult& r) {
  std::vector<Drift> drifts;
  AddDrift(drifts, "memory after the part", "MB", r.part_memory_mb, 4);
  AddDrift(drifts, "last profile to LRA", "ms", r.lra_ms, 5);
  AddDrift(drifts, "last profile to committed", "ms", r.committed_ms, 10);
  const auto add = [&](const char* letter, const char* unit,
                       const std::vector<std::vector<double>>& errors, double matters) {
    for (std::size_t row = 0; row < errors.size(); ++row) {
      AddDrift(drifts, std::string("error of ") + letter + std::to_string(row + 1), unit,
               errors[row], matters);
    }
  };
  add("L", "mm", r.length_error_mm, 0.02);
  add("R", "degree", r.rotation_error_deg, 0.005);
  add("A", "degree", r.angle_error_deg, 0.005);
  return drifts;
}

void PrintDrifts(std::ostream& out, const LoadResult& r, const std::vector<Drift>& drifts) {
  const std::size_t warm = WarmParts(r.part_memory_mb.size());
  if (drifts.empty()) {
    out << "Too few parts to see a drift: " << r.part_memory_mb.size() << "\n\n";
    return;
  }
  std::vector<std::vector<std::string>> lines = {{"what", "first tenth", "last tenth",
                                                  "slope per 1000 parts", "1 sigma", "matters from",
                                                  "drift"}};
  for (const Drift& d : drifts) {
    lines.push_back({d.what, Fine(d.first) + " " + d.unit, Fine(d.last) + " " + d.unit,
                     Fine(d.per_1000_parts), Fine(d.sigma).substr(1), Number(d.matters),
                     d.drifts ? "drifts" : "none"});
  }
  PrintMarkdown(out,
                "Drift over parts " + std::to_string(warm + 1) + " to " +
                    std::to_string(r.part_memory_mb.size()),
                lines, {false, true, true, true, true, true, false});
  if (r.wrong_bends > 0) {
    out << r.wrong_bends << " parts had the wrong number of bends; their errors are left out.\n\n";
  }
}

nlohmann::json ToJson(const std::vector<Drift>& drifts) {
  nlohmann::json list = nlohmann::json::array();
  for (const Drift& d : drifts) {
    list.push_back({{"what", d.what},
                    {"unit", d.unit},
                    {"first_tenth", d.first},
                    {"last_tenth", d.last},
                    {"per_1000_parts", d.per_1000_parts},
                    {"sigma", d.sigma},
                    {"matters_from", d.matters},
                    {"drifts", d.drifts}});
  }
  return list;
}

}  // namespace bendloop::bench
