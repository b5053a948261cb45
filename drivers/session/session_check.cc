// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_check.h"

#include <sys/stat.h>

#include <algorithm>
#include <limits>
#include <string_view>

#include "drivers/session/session_database.h"
#include "drivers/session/session_format.h"
#include "drivers/session/session_reader.h"

namespace bendloop::drivers {
namespace {

constexpr std::size_t kMaxProblems = 100;
// No scan takes a day: times that lie further apart are damage.
constexpr std::int64_t kLongestScanNs = 86'400'000'000'000;

void Add(SessionSummary& summary, const std::string& problem) {
  if (summary.problems.size() < kMaxProblems) {
    summary.problems.push_back(problem);
  } else {
    ++summary.problems_left_out;
  }
}

// SQLite's own look at its pages: the first thing that it finds, as the rest follows from that.
void CheckPages(const SessionReader& reader, SessionSummary& summary) {
  auto check = reader.database().Prepare("PRAGMA quick_check(1)");
  if (!check) return Add(summary, check.error().message);
  const auto outcome = check->Step();
  if (outcome == Statement::Outcome::kFailed) {
    return Add(summary, reader.database().Failed("cannot check the pages").message);
  }
  std::string_view lines = outcome == Statement::Outcome::kRow ? check->Text(0) : "no answer";
  if (lines == "ok") return;
  if (lines.starts_with("***")) lines.remove_prefix(std::min(lines.find('\n') + 1, lines.size()));
  Add(summary, reader.path() + ": the database is damaged, first: " +
                   std::string(lines.substr(0, lines.find('\n'))) + MendOfSession(reader.path()));
}

void CheckTimes(const std::string& path, std::int64_t earliest, std::int64_t latest,
                SessionSummary& summary) {
  if (summary.profiles == 0) return Add(summary, path + ": holds no profile: nothing to replay");
  const std::uint64_t apart =
      static_cast<std::uint64_t>(latest) - static_cast<std::uint64_t>(earliest);
  if (apart <= std::uint64_t{kLongestScanNs}) return;
  Add(summary, path + ": table profile: t_ns goes from " + std::to_string(earliest) + " to " +
                   std::to_string(latest) + ", more than a day; expected nanoseconds of one scan");
}

// What the file said of itself when it was closed.
void CheckDigest(const SessionReader& reader, bool has_log, SessionSummary& summary) {
  if (!reader.has_sums()) return;
  const std::string stated = reader.MetaOr(kSessionDigestKey, "");
  if (stated.empty()) {
    summary.warnings.push_back(
        reader.path() + ": was never closed: the recorder was cut off, or still writes; " +
        (has_log ? "the log beside it, " + reader.path() + "-wal, belongs to it: keep both together"
                 : "what its log (" + reader.path() + "-wal) held and was not kept is missing"));
  } else if (const std::string found = reader.DigestText(); stated != found) {
    Add(summary, reader.path() + ": table meta, key digest: found \"" + found +
                     "\" in the file, expected \"" + stated.substr(0, 100) +
                     "\": rows are missing, altered or added since it was closed");
  }
}

void CheckProfiles(SessionReader& reader, SessionSummary& summary) {
  hal::LaserProfile profile(reader.max_points());
  std::size_t backward = 0;
  std::size_t lost = 0;
  bool first = true;
  std::uint64_t sequence_before = 0;
  std::int64_t earliest = std::numeric_limits<std::int64_t>::max();
  std::int64_t latest = std::numeric_limits<std::int64_t>::min();
  while (!reader.damaged()) {
    const auto taken = reader.NextProfile(profile);
    if (!taken) {
      Add(summary, taken.error().message);
      continue;
    }
    if (!*taken) break;
    if (first) summary.first_t_ns = profile.t_ns;
    if (!first && profile.t_ns < summary.last_t_ns) ++backward;
    if (!first) lost += profile.sequence - sequence_before - 1;
    first = false;
    sequence_before = profile.sequence;
    summary.last_t_ns = profile.t_ns;
    earliest = std::min(earliest, profile.t_ns);
    latest = std::max(latest, profile.t_ns);
    ++summary.profiles;
    summary.points += profile.points.size();
  }
  CheckTimes(reader.path(), earliest, latest, summary);
  if (backward > 0) {
    summary.warnings.push_back(reader.path() + ": table profile: t_ns goes back " +
                               std::to_string(backward) + " times");
  }
  if (lost > 0) {
    summary.warnings.push_back(reader.path() + ": table profile: " + std::to_string(lost) +
                               " seq numbers are missing");
  }
  if (reader.points_left_out() > 0) {
    summary.warnings.push_back(reader.path() +
                               ": table profile: " + std::to_string(reader.points_left_out()) +
                               " of " + std::to_string(reader.points_left_out() + summary.points) +
                               " points are not finite numbers and are left out");
  }
  if (reader.intensities_ignored() > 0) {
    summary.warnings.push_back(reader.path() + ": table profile: intensity ignored in " +
                               std::to_string(reader.intensities_ignored()) +
                               " profiles; expected a blob of one byte a point");
  }
}

}  // namespace

hal::Result<SessionSummary> CheckSession(const std::string& path) {
  auto reader = SessionReader::Open(path);
  if (!reader) return hal::Fail(reader.error());
  SessionSummary summary;
  summary.meta = reader->meta();
  summary.max_points = reader->max_points();
  CheckPages(*reader, summary);
  CheckProfiles(*reader, summary);
  hal::ScanEvent event;
  while (true) {
    const auto taken = reader->NextEvent(event);
    if (!taken) {
      Add(summary, taken.error().message);
      if (reader->damaged()) break;
      continue;
    }
    if (!*taken) break;
    ++summary.events;
  }
  struct stat status {};
  const bool has_log = stat((path + "-wal").c_str(), &status) == 0 && status.st_size > 0;
  if (has_log && !reader->has_sums()) {
    summary.warnings.push_back(path + ": not finished, a log stands beside it; keep " + path +
                               "-wal with it");
  }
  CheckDigest(*reader, has_log, summary);
  return summary;
}

}  // namespace bendloop::drivers
