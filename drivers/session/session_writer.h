// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "drivers/session/session_database.h"
#include "drivers/session/session_digest.h"
#include "hal/clock.h"
#include "hal/laser_profile.h"
#include "hal/result.h"
#include "hal/scan_event.h"

namespace bendloop::drivers {

struct SessionWriterOptions {
  bool replace = false;  // an existing file; otherwise it is an error
  // What power loss may cost at most.
  std::chrono::nanoseconds commit_interval = std::chrono::seconds(1);
  std::size_t commit_profiles = 1000;
  bool sync = true;  // wait for the disk at each commit; off only for made-up sessions
};

// Records a session file (README.md). Everything up to the last commit survives power loss; a
// commit happens inside Write() or Tick() when the interval on the caller's clock is over or
// enough profiles wait. One thread.
class SessionWriter {
 public:
  // `clock` must outlive the writer. "units" is written as mm.
  static hal::Result<SessionWriter> Create(const std::string& path, const hal::Clock& clock,
                                           SessionWriterOptions options = {});

  SessionWriter(SessionWriter&&) = default;
  SessionWriter& operator=(SessionWriter&&) = default;
  SessionWriter(const SessionWriter&) = delete;
  SessionWriter& operator=(const SessionWriter&) = delete;
  // Finishes if nobody did; errors are lost then.
  ~SessionWriter();

  // Sets or replaces one entry; see README.md for the keys in use.
  hal::Result<void> SetMeta(const std::string& key, const std::string& value);
  hal::Result<void> SetMeta(const std::map<std::string, std::string>& entries);

  // kBadInput, and nothing is written, for a profile that no reader would accept: a sequence that
  // is already there, values that are not finite, a pose that is not a rotation, too many points.
  // The writer stays usable then. kDevice: the disk.
  hal::Result<void> Write(const hal::LaserProfile& profile);
  hal::Result<void> Write(const hal::ScanEvent& event);

  // Commits if the interval is over; for times without profiles.
  hal::Result<void> Tick();
  hal::Result<void> Commit();
  // Commits, with the digest of everything, and leaves one single file behind. Nothing can be
  // written any more.
  hal::Result<void> Finish();

  std::size_t profiles() const { return profiles_; }
  std::size_t events() const { return events_; }
  const std::string& path() const { return path_; }

 private:
  SessionWriter() = default;
  hal::Result<void> Begin();
  hal::Result<void> Run(Statement& statement, const std::string& what);
  hal::Result<void> WriteDigest();

  std::string path_;
  const hal::Clock* clock_ = nullptr;
  SessionWriterOptions options_;
  Database database_;  // none once it is finished
  Statement insert_meta_;
  Statement insert_profile_;
  Statement insert_event_;
  bool in_transaction_ = false;
  std::chrono::nanoseconds begun_{0};
  std::size_t waiting_ = 0;
  std::size_t profiles_ = 0;
  std::size_t events_ = 0;
  std::vector<unsigned char> points_bytes_;
  SessionDigest digest_;  // of profiles and events
  bool lost_ = false;     // some of these are not in the file: the disk
};

}  // namespace bendloop::drivers
