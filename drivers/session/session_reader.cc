// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_reader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <initializer_list>
#include <string_view>

#include "drivers/session/session_blob.h"
#include "drivers/session/session_format.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

constexpr std::size_t kMaxMetaEntries = 1000;
constexpr std::size_t kMaxMetaBytes = 1 << 20;

std::string_view TextColumn(sqlite3_stmt* statement, int column) {
  const auto* const text = sqlite3_column_text(statement, column);
  if (text == nullptr) return {};
  return {reinterpret_cast<const char*>(text),
          static_cast<std::size_t>(sqlite3_column_bytes(statement, column))};
}

const char* TypeName(sqlite3_stmt* statement, int column) {
  switch (sqlite3_column_type(statement, column)) {
    case SQLITE_INTEGER:
      return "an integer";
    case SQLITE_FLOAT:
      return "a real number";
    case SQLITE_TEXT:
      return "text";
    case SQLITE_BLOB:
      return "a blob";
    default:
      return "NULL";
  }
}

std::string Hex(std::int64_t value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "0x%08llX", static_cast<unsigned long long>(value));
  return text.data();
}

}  // namespace

Result<SessionReader> SessionReader::Open(const std::string& path) {
  SessionReader reader;
  reader.path_ = path;
  auto database = OpenSessionReadOnly(path);
  if (!database) return Fail(database.error());
  reader.database_ = std::move(*database);
  if (auto checked = reader.CheckHead(); !checked) return Fail(checked.error());
  if (auto read = reader.ReadMeta(); !read) return Fail(read.error());
  reader.FindMaxPoints();
  auto profiles = Prepare(reader.database_.get(), path,
                          "SELECT seq, t_ns, pose, points, intensity FROM profile ORDER BY seq");
  if (!profiles) return Fail(profiles.error());
  reader.select_profile_ = std::move(*profiles);
  auto events = Prepare(reader.database_.get(), path,
                        "SELECT t_ns, kind, detail FROM event ORDER BY t_ns, rowid");
  if (!events) return Fail(events.error());
  reader.select_event_ = std::move(*events);
  return reader;
}

std::string SessionReader::MetaOr(const std::string& key, const std::string& otherwise) const {
  const auto found = meta_.find(key);
  return found == meta_.end() ? otherwise : found->second;
}

Result<std::int64_t> SessionReader::ReadNumber(const char* sql) {
  auto statement = Prepare(database_.get(), path_, sql);
  if (!statement) return Fail(statement.error());
  if (sqlite3_step(statement->get()) != SQLITE_ROW) {
    return Fail(DatabaseError(database_.get(), path_, std::string("cannot run \"") + sql + "\""));
  }
  return sqlite3_column_int64(statement->get(), 0);
}

Result<void> SessionReader::CheckHead() {
  const auto id = ReadNumber("PRAGMA application_id");
  if (!id) return Fail(id.error());
  if (*id != kSessionApplicationId) {
    return Fail(ErrorKind::kBadInput, path_ + ": application_id is " + Hex(*id) + ", expected " +
                                          Hex(kSessionApplicationId) +
                                          "; this database is not a session");
  }
  const auto version = ReadNumber("PRAGMA user_version");
  if (!version) return Fail(version.error());
  if (*version != kSessionVersion) {
    return Fail(ErrorKind::kBadInput, path_ + ": user_version is " + std::to_string(*version) +
                                          ", expected " + std::to_string(kSessionVersion) +
                                          "; use the software version that wrote it");
  }
  auto checked = CheckTable("meta", {"key", "value"});
  if (checked) checked = CheckTable("profile", {"seq", "t_ns", "pose", "points", "intensity"});
  if (checked) checked = CheckTable("event", {"t_ns", "kind", "detail"});
  return checked;
}

Result<void> SessionReader::CheckTable(const char* table,
                                       std::initializer_list<const char*> columns) {
  auto kind = Prepare(database_.get(), path_,
                      "SELECT type, rootpage FROM sqlite_schema WHERE name = ? COLLATE NOCASE");
  if (!kind) return Fail(kind.error());
  sqlite3_bind_text(kind->get(), 1, table, -1, SQLITE_STATIC);
  const int found = sqlite3_step(kind->get());
  if (found != SQLITE_ROW && found != SQLITE_DONE) {
    return Fail(DatabaseError(database_.get(), path_, "cannot read the list of tables"));
  }
  // Views and virtual tables have no root page.
  if (found == SQLITE_DONE || TextColumn(kind->get(), 0) != "table" ||
      sqlite3_column_int64(kind->get(), 1) <= 0) {
    return Fail(ErrorKind::kBadInput,
                path_ + ": table " + table + ": missing; the file is no complete session");
  }
  auto info = Prepare(database_.get(), path_, "SELECT name FROM pragma_table_xinfo(?)");
  if (!info) return Fail(info.error());
  sqlite3_bind_text(info->get(), 1, table, -1, SQLITE_STATIC);
  std::string names;
  std::size_t present = 0;
  for (int rows = 0; rows < 100 && sqlite3_step(info->get()) == SQLITE_ROW; ++rows) {
    const std::string name(TextColumn(info->get(), 0));
    names += (names.empty() ? "" : ", ") + name;
    if (std::find_if(columns.begin(), columns.end(),
                     [&](const char* column) { return name == column; }) != columns.end()) {
      ++present;
    }
  }
  if (present == columns.size()) return {};
  std::string expected;
  for (const char* column : columns)
    expected += (expected.empty() ? "" : ", ") + std::string(column);
  return Fail(ErrorKind::kBadInput, path_ + ": table " + table + ": columns are (" + names +
                                        "), expected (" + expected + ")");
}

Result<void> SessionReader::ReadMeta() {
  auto select = Prepare(database_.get(), path_, "SELECT key, value FROM meta");
  if (!select) return Fail(select.error());
  int code = SQLITE_ROW;
  while ((code = sqlite3_step(select->get())) == SQLITE_ROW) {
    const std::string_view key = TextColumn(select->get(), 0);
    const std::string_view value = TextColumn(select->get(), 1);
    if (meta_.size() >= kMaxMetaEntries || key.size() + value.size() > kMaxMetaBytes) {
      return Fail(ErrorKind::kBadInput,
                  path_ + ": table meta: more than " + std::to_string(kMaxMetaEntries) +
                      " entries or one of more than " + std::to_string(kMaxMetaBytes) + " bytes");
    }
    meta_[std::string(key)] = std::string(value);
  }
  if (code != SQLITE_DONE) {
    return Fail(DatabaseError(database_.get(), path_, "table meta: cannot be read"));
  }
  const std::string units = MetaOr("units", "mm");
  if (units != "mm") {
    return Fail(ErrorKind::kBadInput, path_ + ": table meta, key units: found \"" +
                                          units.substr(0, 20) + "\", expected \"mm\"");
  }
  return {};
}

void SessionReader::FindMaxPoints() {
  // Damage ends the search early; reading will then end before a longer profile is reached.
  auto lengths = Prepare(database_.get(), path_,
                         "SELECT CASE typeof(points) WHEN 'blob' THEN length(points) ELSE 0 END "
                         "FROM profile ORDER BY seq");
  if (!lengths) return;
  while (sqlite3_step(lengths->get()) == SQLITE_ROW) {
    const auto bytes = static_cast<std::size_t>(sqlite3_column_int64(lengths->get(), 0));
    max_points_ = std::max(max_points_, std::min(bytes / kSessionPointBytes, kSessionMaxPoints));
  }
}

Result<void> SessionReader::Advance(sqlite3_stmt* statement, Cursor& cursor, const char* table) {
  if (cursor != Cursor::kBeforeRow) return {};
  const int code = sqlite3_step(statement);
  if (code == SQLITE_ROW) {
    cursor = Cursor::kOnRow;
    return {};
  }
  cursor = Cursor::kEnd;
  if (code == SQLITE_DONE) return {};
  damaged_ = true;
  return Fail(DatabaseError(database_.get(), path_,
                            std::string("table ") + table + ": damaged after " +
                                std::to_string(profiles_read_) + " profiles (last seq " +
                                std::to_string(last_sequence_) + ") and " +
                                std::to_string(events_read_) + " events"));
}

Result<std::optional<std::int64_t>> SessionReader::PeekProfile() {
  if (auto moved = Advance(select_profile_.get(), profile_cursor_, "profile"); !moved) {
    return Fail(moved.error());
  }
  if (profile_cursor_ == Cursor::kEnd) return std::optional<std::int64_t>();
  return std::optional(sqlite3_column_int64(select_profile_.get(), 1));
}

Result<std::optional<std::int64_t>> SessionReader::PeekEvent() {
  if (auto moved = Advance(select_event_.get(), event_cursor_, "event"); !moved) {
    return Fail(moved.error());
  }
  if (event_cursor_ == Cursor::kEnd) return std::optional<std::int64_t>();
  return std::optional(sqlite3_column_int64(select_event_.get(), 0));
}

Result<bool> SessionReader::NextProfile(hal::LaserProfile& profile) {
  if (auto moved = Advance(select_profile_.get(), profile_cursor_, "profile"); !moved) {
    return Fail(moved.error());
  }
  if (profile_cursor_ == Cursor::kEnd) return false;
  profile_cursor_ = Cursor::kBeforeRow;
  if (auto decoded = DecodeProfile(profile); !decoded) return Fail(decoded.error());
  ++profiles_read_;
  return true;
}

Result<void> SessionReader::DecodeProfile(hal::LaserProfile& profile) {
  sqlite3_stmt* const row = select_profile_.get();
  const std::int64_t sequence = sqlite3_column_int64(row, 0);
  const auto fail = [&](const std::string& why) {
    return Fail(ErrorKind::kBadInput,
                path_ + ": table profile, seq " + std::to_string(sequence) + ": " + why);
  };
  const std::int64_t before = last_sequence_;
  if (sequence < 0) return fail("a negative seq; expected 0 or more");
  if (sequence <= before) {
    // An index that lies could lead round in circles.
    damaged_ = true;
    profile_cursor_ = Cursor::kEnd;
    return fail("follows seq " + std::to_string(before) + "; the table is damaged");
  }
  last_sequence_ = sequence;
  if (sqlite3_column_type(row, 1) != SQLITE_INTEGER) {
    return fail(std::string("t_ns is ") + TypeName(row, 1) + ", expected an integer");
  }
  if (sqlite3_column_type(row, 2) != SQLITE_BLOB) {
    return fail(std::string("pose is ") + TypeName(row, 2) + ", expected a blob");
  }
  const auto pose_bytes = static_cast<std::size_t>(sqlite3_column_bytes(row, 2));
  if (pose_bytes != kSessionPoseBytes) {
    return fail("pose has " + std::to_string(pose_bytes) + " bytes, expected " +
                std::to_string(kSessionPoseBytes) + " (7 float64)");
  }
  const auto* const pose = static_cast<const unsigned char*>(sqlite3_column_blob(row, 2));
  std::array<double, 7> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = LoadFloat64(pose + 8 * i);
    if (!std::isfinite(numbers[i])) {
      return fail("pose, byte " + std::to_string(8 * i) + ": not a finite number");
    }
  }
  const Eigen::Quaterniond orientation(numbers[3], numbers[4], numbers[5], numbers[6]);
  if (!(std::abs(orientation.norm() - 1.0) <= kSessionUnitTolerance)) {
    return fail("pose, byte 24: the quaternion has length " + std::to_string(orientation.norm()) +
                ", expected 1");
  }
  if (sqlite3_column_type(row, 3) != SQLITE_BLOB) {
    return fail(std::string("points is ") + TypeName(row, 3) + ", expected a blob");
  }
  const auto* const points = static_cast<const unsigned char*>(sqlite3_column_blob(row, 3));
  const auto point_bytes = static_cast<std::size_t>(sqlite3_column_bytes(row, 3));
  if (point_bytes > 0 && points == nullptr) return fail("points cannot be read");
  if (point_bytes % kSessionPointBytes != 0) {
    return fail("points has " + std::to_string(point_bytes) + " bytes, expected a multiple of " +
                std::to_string(kSessionPointBytes) + " (pairs of float32)");
  }
  const std::size_t count = point_bytes / kSessionPointBytes;
  if (count > kSessionMaxPoints) {
    return fail(std::to_string(count) + " points; at most " + std::to_string(kSessionMaxPoints) +
                " are allowed");
  }
  profile.sequence = static_cast<std::uint64_t>(sequence);
  profile.t_ns = sqlite3_column_int64(row, 1);
  profile.X_WS.position_mm = {numbers[0], numbers[1], numbers[2]};
  profile.X_WS.orientation = orientation;
  const unsigned char* intensity = nullptr;
  if (sqlite3_column_type(row, 4) != SQLITE_NULL) {
    const auto* const blob = static_cast<const unsigned char*>(sqlite3_column_blob(row, 4));
    const auto bytes = static_cast<std::size_t>(sqlite3_column_bytes(row, 4));
    const bool fits = sqlite3_column_type(row, 4) == SQLITE_BLOB && bytes == count;
    if (fits) intensity = blob;
    if (!fits) ++intensities_ignored_;
  }
  profile.points.clear();
  profile.intensity.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned char* const bytes = points + i * kSessionPointBytes;
    const hal::ProfilePoint point{LoadFloat32(bytes), LoadFloat32(bytes + sizeof(float))};
    if (!std::isfinite(point.x_mm) || !std::isfinite(point.z_mm)) {
      ++points_left_out_;
      continue;
    }
    profile.points.push_back(point);
    if (intensity != nullptr) profile.intensity.push_back(intensity[i]);
  }
  return {};
}

Result<bool> SessionReader::NextEvent(hal::ScanEvent& event) {
  if (auto moved = Advance(select_event_.get(), event_cursor_, "event"); !moved) {
    return Fail(moved.error());
  }
  if (event_cursor_ == Cursor::kEnd) return false;
  event_cursor_ = Cursor::kBeforeRow;
  sqlite3_stmt* const row = select_event_.get();
  if (sqlite3_column_type(row, 0) != SQLITE_INTEGER) {
    return Fail(ErrorKind::kBadInput, path_ + ": table event, row " +
                                          std::to_string(events_read_ + 1) + ": t_ns is " +
                                          TypeName(row, 0) + ", expected an integer");
  }
  event.t_ns = sqlite3_column_int64(row, 0);
  const std::string_view kind = TextColumn(row, 1);
  const std::string_view detail = TextColumn(row, 2);
  event.kind = hal::ScanEventKindFromName(kind);
  if (event.kind == hal::ScanEventKind::kOther && kind != hal::Name(event.kind)) {
    event.set_detail(std::string(kind.substr(0, 200)) + ": " + std::string(detail.substr(0, 200)));
  } else {
    event.set_detail(detail);
  }
  ++events_read_;
  return true;
}

}  // namespace bendloop::drivers
