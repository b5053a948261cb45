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
using Outcome = Statement::Outcome;
using Type = Statement::Type;

constexpr std::size_t kMaxMetaEntries = 1000;
constexpr std::size_t kMaxMetaBytes = 1 << 20;

const char* TypeName(const Statement& row, int column) {
  switch (row.type(column)) {
    case Type::kInteger:
      return "an integer";
    case Type::kReal:
      return "a real number";
    case Type::kText:
      return "text";
    case Type::kBlob:
      return "a blob";
    case Type::kNull:
      break;
  }
  return "NULL";
}

std::string Hex(std::int64_t value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "0x%08llX", static_cast<unsigned long long>(value));
  return text.data();
}

// What is wrong with the pose of a row; empty: nothing.
std::string DecodePose(const Statement& row, hal::Pose& pose) {
  if (row.type(2) != Type::kBlob) {
    return std::string("pose is ") + TypeName(row, 2) + ", expected a blob";
  }
  const auto bytes = row.Blob(2);
  if (bytes.size() != kSessionPoseBytes) {
    return "pose has " + std::to_string(bytes.size()) + " bytes, expected " +
           std::to_string(kSessionPoseBytes) + " (7 float64)";
  }
  std::array<double, 7> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = LoadFloat64(bytes.data() + 8 * i);
    if (!std::isfinite(numbers[i])) {
      return "pose, byte " + std::to_string(8 * i) + ": not a finite number";
    }
  }
  pose.position_mm = {numbers[0], numbers[1], numbers[2]};
  pose.orientation = Eigen::Quaterniond(numbers[3], numbers[4], numbers[5], numbers[6]);
  if (!(std::abs(pose.orientation.norm() - 1.0) <= kSessionUnitTolerance)) {
    return "pose, byte 24: the quaternion has length " + std::to_string(pose.orientation.norm()) +
           ", expected 1";
  }
  return {};
}

// The same of its points.
std::string CheckPoints(const Statement& row) {
  if (row.type(3) != Type::kBlob) {
    return std::string("points is ") + TypeName(row, 3) + ", expected a blob";
  }
  const std::size_t bytes = row.Blob(3).size();
  if (bytes % kSessionPointBytes != 0) {
    return "points has " + std::to_string(bytes) + " bytes, expected a multiple of " +
           std::to_string(kSessionPointBytes) + " (pairs of float32)";
  }
  const std::size_t count = bytes / kSessionPointBytes;
  if (count > kSessionMaxPoints) {
    return std::to_string(count) + " points; at most " + std::to_string(kSessionMaxPoints) +
           " are allowed";
  }
  return {};
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
  auto profiles = reader.database_.Prepare(
      reader.has_sums() ? "SELECT seq, t_ns, pose, points, intensity, crc FROM profile ORDER BY seq"
                        : "SELECT seq, t_ns, pose, points, intensity FROM profile ORDER BY seq");
  if (!profiles) return Fail(profiles.error());
  reader.select_profile_ = std::move(*profiles);
  auto events =
      reader.database_.Prepare("SELECT t_ns, kind, detail FROM event ORDER BY t_ns, rowid");
  if (!events) return Fail(events.error());
  reader.select_event_ = std::move(*events);
  return reader;
}

std::string SessionReader::MetaOr(const std::string& key, const std::string& otherwise) const {
  const auto found = meta_.find(key);
  return found == meta_.end() ? otherwise : found->second;
}

Result<void> SessionReader::CheckHead() {
  const auto id = database_.Integer("PRAGMA application_id");
  if (!id) return Fail(id.error());
  if (*id != kSessionApplicationId) {
    return Fail(ErrorKind::kBadInput, path_ + ": application_id is " + Hex(*id) + ", expected " +
                                          Hex(kSessionApplicationId) +
                                          "; this database is not a session");
  }
  const auto version = database_.Integer("PRAGMA user_version");
  if (!version) return Fail(version.error());
  version_ = *version;
  if (version_ != kSessionVersion && version_ != kSessionVersionWithoutSums) {
    return Fail(ErrorKind::kBadInput,
                path_ + ": user_version is " + std::to_string(version_) + ", expected " +
                    std::to_string(kSessionVersionWithoutSums) + " or " +
                    std::to_string(kSessionVersion) + "; use the software version that wrote it");
  }
  auto checked = CheckTable("meta", {"key", "value"});
  if (checked) checked = CheckTable("profile", {"seq", "t_ns", "pose", "points", "intensity"});
  if (checked && has_sums()) checked = CheckTable("profile", {"crc"});
  if (checked) checked = CheckTable("event", {"t_ns", "kind", "detail"});
  return checked;
}

Result<void> SessionReader::CheckTable(const char* table,
                                       std::initializer_list<const char*> columns) {
  auto kind =
      database_.Prepare("SELECT type, rootpage FROM sqlite_schema WHERE name = ? COLLATE NOCASE");
  if (!kind) return Fail(kind.error());
  const Outcome found = kind->Bind(std::string_view(table)).Step();
  if (found == Outcome::kFailed) {
    return Fail(database_.Failed("cannot read the list of tables"));
  }
  // Views and virtual tables have no root page.
  if (found == Outcome::kEnd || kind->Text(0) != "table" || kind->Integer(1) <= 0) {
    return Fail(ErrorKind::kBadInput, path_ + ": table " + table +
                                          ": missing; the file is no complete session" +
                                          MendOfSession(path_));
  }
  auto info = database_.Prepare("SELECT name FROM pragma_table_xinfo(?)");
  if (!info) return Fail(info.error());
  info->Bind(std::string_view(table));
  std::string names;
  std::size_t present = 0;
  for (int rows = 0; rows < 100 && info->Step() == Outcome::kRow; ++rows) {
    const std::string name(info->Text(0));
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
  auto select = database_.Prepare("SELECT key, value FROM meta");
  if (!select) return Fail(select.error());
  Outcome outcome = Outcome::kRow;
  while ((outcome = select->Step()) == Outcome::kRow) {
    const std::string_view key = select->Text(0);
    const std::string_view value = select->Text(1);
    if (meta_.size() >= kMaxMetaEntries || key.size() + value.size() > kMaxMetaBytes) {
      return Fail(ErrorKind::kBadInput,
                  path_ + ": table meta: more than " + std::to_string(kMaxMetaEntries) +
                      " entries or one of more than " + std::to_string(kMaxMetaBytes) + " bytes");
    }
    if (key != kSessionDigestKey) digest_.AddMeta(key, value);
    meta_[std::string(key)] = std::string(value);
  }
  if (outcome == Outcome::kFailed) {
    return Fail(database_.Failed("table meta: cannot be read"));
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
  auto lengths = database_.Prepare(
      "SELECT CASE typeof(points) WHEN 'blob' THEN length(points) ELSE 0 END "
      "FROM profile ORDER BY seq");
  if (!lengths) return;
  while (lengths->Step() == Outcome::kRow) {
    const auto bytes = static_cast<std::size_t>(lengths->Integer(0));
    max_points_ = std::max(max_points_, std::min(bytes / kSessionPointBytes, kSessionMaxPoints));
  }
}

Result<void> SessionReader::Advance(Statement& statement, Cursor& cursor, const char* table) {
  if (cursor != Cursor::kBeforeRow) return {};
  const Outcome outcome = statement.Step();
  if (outcome == Outcome::kRow) {
    cursor = Cursor::kOnRow;
    return {};
  }
  cursor = Cursor::kEnd;
  if (outcome == Outcome::kEnd) return {};
  damaged_ = true;
  return Fail(database_.Failed(std::string("table ") + table + ": damaged after " +
                               std::to_string(profiles_read_) + " profiles (last seq " +
                               std::to_string(last_sequence_) + ") and " +
                               std::to_string(events_read_) + " events"));
}

Result<std::optional<std::int64_t>> SessionReader::PeekProfile() {
  if (auto moved = Advance(select_profile_, profile_cursor_, "profile"); !moved) {
    return Fail(moved.error());
  }
  if (profile_cursor_ == Cursor::kEnd) return std::optional<std::int64_t>();
  if (const std::string why = CheckSum(select_profile_); !why.empty()) {
    profile_cursor_ = Cursor::kBeforeRow;
    return Fail(ErrorKind::kBadInput, path_ + ": table profile, seq " +
                                          std::to_string(select_profile_.Integer(0)) + ": " + why);
  }
  return std::optional(select_profile_.Integer(1));
}

Result<std::optional<std::int64_t>> SessionReader::PeekEvent() {
  if (auto moved = Advance(select_event_, event_cursor_, "event"); !moved) {
    return Fail(moved.error());
  }
  if (event_cursor_ == Cursor::kEnd) return std::optional<std::int64_t>();
  return std::optional(select_event_.Integer(0));
}

Result<bool> SessionReader::NextProfile(hal::LaserProfile& profile) {
  if (auto moved = Advance(select_profile_, profile_cursor_, "profile"); !moved) {
    return Fail(moved.error());
  }
  if (profile_cursor_ == Cursor::kEnd) return false;
  profile_cursor_ = Cursor::kBeforeRow;
  if (auto decoded = DecodeProfile(profile); !decoded) return Fail(decoded.error());
  ++profiles_read_;
  return true;
}

Result<void> SessionReader::DecodeProfile(hal::LaserProfile& profile) {
  const Statement& row = select_profile_;
  const std::int64_t sequence = row.Integer(0);
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
  if (row.type(1) != Type::kInteger) {
    return fail(std::string("t_ns is ") + TypeName(row, 1) + ", expected an integer");
  }
  hal::Pose pose;
  if (const std::string why = DecodePose(row, pose); !why.empty()) return fail(why);
  if (const std::string why = CheckPoints(row); !why.empty()) return fail(why);
  if (row.Blob(3).size() > kSessionPointBytes * max_points_) {
    // The table was another one when it was asked for its longest profile.
    damaged_ = true;
    profile_cursor_ = Cursor::kEnd;
    return fail("more points than the longest profile that was found, " +
                std::to_string(max_points_) + "; the table is damaged");
  }
  if (const std::string why = CheckSum(row); !why.empty()) return fail(why);
  if (has_sums()) digest_.AddProfile(static_cast<std::uint32_t>(row.Integer(5)));
  profile.sequence = static_cast<std::uint64_t>(sequence);
  profile.t_ns = row.Integer(1);
  profile.X_WS = pose;
  DecodePoints(row, profile);
  return {};
}

// What is wrong with the row as a whole; empty: nothing, or nobody knows.
std::string SessionReader::CheckSum(const Statement& row) const {
  if (!has_sums()) return {};
  const auto intensity =
      row.type(4) == Type::kBlob ? row.Blob(4) : std::span<const unsigned char>();
  const std::uint32_t sum =
      ProfileSum(row.Integer(0), row.Integer(1), row.Blob(2), row.Blob(3), intensity);
  if (row.type(5) != Type::kInteger || row.Integer(5) != std::int64_t{sum}) {
    return "crc is " + (row.type(5) == Type::kInteger ? Hex(row.Integer(5)) : TypeName(row, 5)) +
           ", expected " + Hex(sum) + "; the profile is damaged";
  }
  return {};
}

std::string SessionReader::DigestText() const { return digest_.Text(); }

void SessionReader::DecodePoints(const Statement& row, hal::LaserProfile& profile) {
  const auto points = row.Blob(3);
  const std::size_t count = points.size() / kSessionPointBytes;
  const unsigned char* intensity = nullptr;
  if (row.type(4) != Type::kNull) {
    const auto values = row.Blob(4);
    const bool fits = row.type(4) == Type::kBlob && values.size() == count;
    if (fits) intensity = values.data();
    if (!fits) ++intensities_ignored_;
  }
  profile.points.clear();
  profile.intensity.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const unsigned char* const bytes = points.data() + i * kSessionPointBytes;
    const hal::ProfilePoint point{LoadFloat32(bytes), LoadFloat32(bytes + sizeof(float))};
    if (!std::isfinite(point.x_mm) || !std::isfinite(point.z_mm)) {
      ++points_left_out_;
      continue;
    }
    profile.points.push_back(point);
    if (intensity != nullptr) profile.intensity.push_back(intensity[i]);
  }
}

Result<bool> SessionReader::NextEvent(hal::ScanEvent& event) {
  if (auto moved = Advance(select_event_, event_cursor_, "event"); !moved) {
    return Fail(moved.error());
  }
  if (event_cursor_ == Cursor::kEnd) return false;
  event_cursor_ = Cursor::kBeforeRow;
  const Statement& row = select_event_;
  if (row.type(0) != Type::kInteger) {
    return Fail(ErrorKind::kBadInput, path_ + ": table event, row " +
                                          std::to_string(events_read_ + 1) + ": t_ns is " +
                                          TypeName(row, 0) + ", expected an integer");
  }
  event.t_ns = row.Integer(0);
  const std::string_view kind = row.Text(1);
  const std::string_view detail = row.Text(2);
  digest_.AddEvent(event.t_ns, kind, detail);
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
