// SPDX-License-Identifier: Apache-2.0
#include "drivers/session/session_writer.h"

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <new>
#include <span>
#include <string_view>
#include <system_error>

#include "drivers/session/session_blob.h"
#include "drivers/session/session_format.h"
#include "drivers/sqlite/side_files.h"

namespace bendloop::drivers {
namespace {

using hal::ErrorKind;
using hal::Fail;
using hal::Result;

std::string ProfileName(const std::string& path, std::uint64_t sequence) {
  return path + ": table profile, seq " + std::to_string(sequence) + ": ";
}

Result<void> CheckWritable(const std::string& path, const hal::LaserProfile& profile) {
  const auto fail = [&](const std::string& why) {
    return Fail(ErrorKind::kBadInput, ProfileName(path, profile.sequence) + why);
  };
  if (profile.sequence > std::uint64_t{std::numeric_limits<std::int64_t>::max()}) {
    return fail("the sequence does not fit the file's signed 64 bits");
  }
  if (profile.points.size() > kSessionMaxPoints) {
    return fail(std::to_string(profile.points.size()) + " points; at most " +
                std::to_string(kSessionMaxPoints) + " are allowed");
  }
  if (!profile.intensity.empty() && profile.intensity.size() != profile.points.size()) {
    return fail(std::to_string(profile.intensity.size()) + " intensities for " +
                std::to_string(profile.points.size()) + " points; expected one a point or none");
  }
  if (!profile.X_WS.position_mm.allFinite() ||
      !(std::abs(profile.X_WS.orientation.norm() - 1.0) <= kSessionUnitTolerance)) {
    return fail("the pose is not finite or its quaternion is not of unit length");
  }
  for (std::size_t i = 0; i < profile.points.size(); ++i) {
    if (!std::isfinite(profile.points[i].x_mm) || !std::isfinite(profile.points[i].z_mm)) {
      return fail("point " + std::to_string(i) + " is not finite");
    }
  }
  return {};
}

}  // namespace

Result<SessionWriter> SessionWriter::Create(const std::string& path, const hal::Clock& clock,
                                            SessionWriterOptions options) {
  std::error_code error;
  if (std::filesystem::exists(path, error)) {
    if (!options.replace) {
      return Fail(ErrorKind::kBadInput,
                  path + ": exists; a session is not recorded over another, choose a new name");
    }
    if (!std::filesystem::is_regular_file(path, error)) {
      return Fail(ErrorKind::kBadInput, path + ": not a regular file; choose another name");
    }
    std::filesystem::remove(path, error);
  }
  RemoveSideFiles(path);

  SessionWriter writer;
  writer.path_ = path;
  writer.clock_ = &clock;
  writer.options_ = options;
  auto database = OpenSessionForWriting(path);
  if (!database) return Fail(database.error());
  writer.database_ = std::move(*database);
  // The empty tables are in the file itself before the log begins, so that the file alone is
  // always a session. One fsync a commit (FULL): NORMAL would lose more than the last interval.
  const std::string set_up =
      "PRAGMA page_size=16384; PRAGMA synchronous=" + std::string(options.sync ? "FULL" : "OFF") +
      "; PRAGMA application_id=" + std::to_string(kSessionApplicationId) +
      "; PRAGMA user_version=" + std::to_string(kSessionVersion) + "; BEGIN; " + kSessionTables +
      " INSERT INTO meta VALUES('units', 'mm'); COMMIT; "
      "PRAGMA journal_mode=WAL;";
  if (auto done = writer.database_.Execute(set_up); !done) {
    // On a full disk. Without its tables it would be no session, and in the way of one.
    writer.database_ = {};
    std::filesystem::remove(path, error);
    RemoveSideFiles(path);
    return Fail(done.error());
  }

  const auto prepare = [&](Statement& statement, const char* sql) -> Result<void> {
    auto prepared = writer.database_.Prepare(sql);
    if (!prepared) return Fail(prepared.error());
    statement = std::move(*prepared);
    return {};
  };
  auto done = prepare(writer.insert_meta_, "INSERT OR REPLACE INTO meta VALUES(?, ?)");
  if (done) done = prepare(writer.insert_profile_, "INSERT INTO profile VALUES(?, ?, ?, ?, ?, ?)");
  if (done) done = prepare(writer.insert_event_, "INSERT INTO event VALUES(?, ?, ?)");
  if (!done) return Fail(done.error());
  return writer;
}

SessionWriter::~SessionWriter() {
  if (!database_) return;
  try {
    (void)Finish();
  } catch (const std::bad_alloc&) {
    // As after a power cut: what was committed is there.
  }
}

Result<void> SessionWriter::Begin() {
  if (!database_) {
    return Fail(ErrorKind::kInternal, path_ + ": the session is finished; nothing can be written");
  }
  if (in_transaction_) return {};
  if (auto begun = database_.Execute("BEGIN"); !begun) return begun;
  in_transaction_ = true;
  begun_ = clock_->Now();
  waiting_ = 0;
  return {};
}

Result<void> SessionWriter::Run(Statement& statement, const std::string& what) {
  auto done = database_.Run(statement, what);
  // Some errors (a full disk) end the transaction by themselves.
  if (!database_.in_transaction()) {
    in_transaction_ = false;
    lost_ = true;
  }
  return done;
}

Result<void> SessionWriter::SetMeta(const std::string& key, const std::string& value) {
  if (auto begun = Begin(); !begun) return begun;
  insert_meta_.Bind(key).Bind(value);
  if (auto done = Run(insert_meta_, "table meta, key " + key); !done) return done;
  return Tick();
}

Result<void> SessionWriter::SetMeta(const std::map<std::string, std::string>& entries) {
  for (const auto& [key, value] : entries) {
    if (auto done = SetMeta(key, value); !done) return done;
  }
  return {};
}

Result<void> SessionWriter::Write(const hal::LaserProfile& profile) {
  if (auto checked = CheckWritable(path_, profile); !checked) return checked;
  if (auto begun = Begin(); !begun) return begun;

  std::array<unsigned char, kSessionPoseBytes> pose{};
  const auto& X_WS = profile.X_WS;
  const std::array<double, 7> numbers = {
      X_WS.position_mm.x(), X_WS.position_mm.y(), X_WS.position_mm.z(), X_WS.orientation.w(),
      X_WS.orientation.x(), X_WS.orientation.y(), X_WS.orientation.z()};
  for (std::size_t i = 0; i < numbers.size(); ++i) StoreFloat64(numbers[i], &pose[8 * i]);
  points_bytes_.resize(profile.points.size() * kSessionPointBytes);
  for (std::size_t i = 0; i < profile.points.size(); ++i) {
    unsigned char* const bytes = points_bytes_.data() + i * kSessionPointBytes;
    StoreFloat32(profile.points[i].x_mm, bytes);
    StoreFloat32(profile.points[i].z_mm, bytes + sizeof(float));
  }

  insert_profile_.Bind(static_cast<std::int64_t>(profile.sequence))
      .Bind(profile.t_ns)
      .Bind(std::span<const unsigned char>(pose))
      .Bind(std::span<const unsigned char>(points_bytes_));
  if (profile.intensity.empty()) {
    insert_profile_.BindNull();
  } else {
    insert_profile_.Bind(std::span<const unsigned char>(profile.intensity));
  }
  const std::uint32_t sum = ProfileSum(static_cast<std::int64_t>(profile.sequence), profile.t_ns,
                                       pose, points_bytes_, profile.intensity);
  insert_profile_.Bind(std::int64_t{sum});
  auto done = Run(insert_profile_, "table profile, seq " + std::to_string(profile.sequence));
  if (!done) return done;
  digest_.AddProfile(sum);
  ++profiles_;
  ++waiting_;
  return Tick();
}

Result<void> SessionWriter::Write(const hal::ScanEvent& event) {
  if (auto begun = Begin(); !begun) return begun;
  const std::string_view kind = hal::Name(event.kind);
  const std::string_view detail = event.detail();
  insert_event_.Bind(event.t_ns).Bind(kind);
  if (detail.empty()) {
    insert_event_.BindNull();
  } else {
    insert_event_.Bind(detail);
  }
  if (auto done = Run(insert_event_, "table event"); !done) return done;
  digest_.AddEvent(event.t_ns, kind, detail);
  ++events_;
  return Tick();
}

Result<void> SessionWriter::Tick() {
  if (!in_transaction_) return {};
  if (waiting_ < options_.commit_profiles && clock_->Now() - begun_ < options_.commit_interval) {
    return {};
  }
  return Commit();
}

Result<void> SessionWriter::Commit() {
  if (!in_transaction_) return {};
  auto committed = database_.Execute("COMMIT");
  if (!committed && database_.in_transaction()) {
    (void)database_.Execute("ROLLBACK");
  }
  if (!committed) lost_ = true;
  in_transaction_ = false;
  waiting_ = 0;
  return committed;
}

Result<void> SessionWriter::WriteDigest() {
  SessionDigest digest = digest_;
  auto select = database_.Prepare("SELECT key, value FROM meta WHERE key <> ?");
  if (!select) return Fail(select.error());
  select->Bind(std::string_view(kSessionDigestKey));
  auto outcome = Statement::Outcome::kRow;
  while ((outcome = select->Step()) == Statement::Outcome::kRow) {
    digest.AddMeta(select->Text(0), select->Text(1));
  }
  if (outcome == Statement::Outcome::kFailed) return Fail(database_.Failed("table meta"));
  *select = {};
  if (auto begun = Begin(); !begun) return begun;
  const std::string text = digest.Text();
  insert_meta_.Bind(std::string_view(kSessionDigestKey)).Bind(text);
  if (auto done = Run(insert_meta_, "table meta, key digest"); !done) return done;
  return Commit();
}

Result<void> SessionWriter::Finish() {
  if (!database_) return {};
  // What a failed commit lost is no part of the file, which then stays without a digest.
  auto result = Commit();
  if (result && !lost_) result = WriteDigest();
  for (Statement* insert : {&insert_meta_, &insert_profile_, &insert_event_}) *insert = {};
  // Leaving log mode moves the whole log into the file and removes it and its index.
  const auto left =
      database_.Execute("PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode=DELETE");
  if (result && !left) result = left;
  database_ = {};
  return result;
}

}  // namespace bendloop::drivers
