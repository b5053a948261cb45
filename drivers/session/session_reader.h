// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "drivers/session/session_database.h"
#include "drivers/session/session_digest.h"
#include "drivers/session/session_format.h"
#include "hal/laser_profile.h"
#include "hal/result.h"
#include "hal/scan_event.h"

namespace bendloop::drivers {

// Reads a session file (README.md), also one cut off by power loss, with a leftover write-ahead
// log, or on read-only media. Profiles come in the order of seq, events in the order of t_ns;
// both can be looked at (time only) before they are taken. Values come back bit for bit.
// Errors are kBadInput and name file, table, seq and what was found.
class SessionReader {
 public:
  // Checks application_id, user_version and the tables' shapes, and reads `meta`.
  static hal::Result<SessionReader> Open(const std::string& path);

  const std::map<std::string, std::string>& meta() const { return meta_; }
  std::string MetaOr(const std::string& key, const std::string& otherwise) const;
  // Most points of one profile in the file, at most kSessionMaxPoints.
  std::size_t max_points() const { return max_points_; }

  // t_ns of the next one; empty at the end. A profile whose checksum is wrong is an error here as
  // in NextProfile, and is passed over: nobody should wait for its time.
  hal::Result<std::optional<std::int64_t>> PeekProfile();
  hal::Result<std::optional<std::int64_t>> PeekEvent();
  // False at the end. After an error in one row the next call takes the next row, unless
  // damaged().
  hal::Result<bool> NextProfile(hal::LaserProfile& profile);
  // An unknown kind comes as kOther with "kind: detail" as its detail.
  hal::Result<bool> NextEvent(hal::ScanEvent& event);

  // The database itself cannot be read further.
  bool damaged() const { return damaged_; }
  std::size_t profiles_read() const { return profiles_read_; }
  std::size_t events_read() const { return events_read_; }
  // Points that are not finite, as scanners mark those that they missed: not in the profiles.
  std::size_t points_left_out() const { return points_left_out_; }
  // Whether rows carry checksums (user_version 2): what is damaged is known by itself, and the rest
  // can be trusted.
  bool has_sums() const { return version_ > kSessionVersionWithoutSums; }
  // Over what was read; equal to the file's own once all of a sound session is.
  std::string DigestText() const;
  // Profiles whose intensity was left out because it has not one value a point.
  std::size_t intensities_ignored() const { return intensities_ignored_; }
  // seq of the last row reached; -1 before the first.
  std::int64_t last_sequence() const { return last_sequence_; }
  const std::string& path() const { return path_; }
  const Database& database() const { return database_; }

 private:
  // Where a statement stands: a row is stepped to at most once.
  enum class Cursor { kBeforeRow, kOnRow, kEnd };

  SessionReader() = default;
  hal::Result<void> CheckHead();
  hal::Result<void> CheckTable(const char* table, std::initializer_list<const char*> columns);
  hal::Result<void> ReadMeta();
  void FindMaxPoints();
  hal::Result<void> Advance(Statement& statement, Cursor& cursor, const char* table);
  hal::Result<void> DecodeProfile(hal::LaserProfile& profile);
  std::string CheckSum(const Statement& row) const;
  void DecodePoints(const Statement& row, hal::LaserProfile& profile);

  std::string path_;
  Database database_;
  Statement select_profile_;
  Statement select_event_;
  Cursor profile_cursor_ = Cursor::kBeforeRow;
  Cursor event_cursor_ = Cursor::kBeforeRow;
  std::map<std::string, std::string> meta_;
  std::size_t max_points_ = 0;
  bool damaged_ = false;
  std::size_t profiles_read_ = 0;
  std::size_t events_read_ = 0;
  std::size_t points_left_out_ = 0;
  std::size_t intensities_ignored_ = 0;
  std::int64_t last_sequence_ = -1;
  std::int64_t version_ = kSessionVersion;
  SessionDigest digest_;
};

}  // namespace bendloop::drivers
