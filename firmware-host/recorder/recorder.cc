// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/recorder/recorder.h"

#include <pthread.h>

#include <new>
#include <optional>
#include <system_error>
#include <utility>

#include "drivers/session/session_writer.h"
#include "firmware-host/workers/want_of_memory.h"
#include "hal/saturating.h"

namespace bendloop::host {

namespace fs = std::filesystem;

namespace {

// With the time that the disk takes, during which others come, a power cut costs less than the last
// second. Counted from when a profile came, as it may have waited for the disk.
constexpr auto kCommitInterval = std::chrono::milliseconds(250);

// How often the age of what is not safe yet is looked at, when nothing comes.
constexpr auto kLookPeriod = std::chrono::milliseconds(50);

// How often a disk is looked at that nothing is written to: what fills it, or gives it back, is
// often somebody else.
constexpr auto kDiskPeriod = std::chrono::seconds(2);

// Sessions that may wait for the disk. Each brings some KB that no other bound counts.
constexpr std::size_t kMostSessions = 64;

// Events that fit where no profile does any more: more than one scan has.
constexpr std::size_t kEventRoom = 1024;

// Written profiles that are kept for the next ones.
constexpr std::size_t kMostSpare = 256;

// Where there is no memory for more words: short enough to need none.
constexpr const char* kNoWords = "out of memory";

}  // namespace

// The file being written.
class Recorder::Session {
 public:
  explicit Session(drivers::SessionWriter w) : writer(std::move(w)) {}
  drivers::SessionWriter writer;
  std::uint64_t dropped = 0;                       // gaps, and profiles that could not be written
  std::optional<std::chrono::nanoseconds> oldest;  // of the profiles that may not be safe yet
  bool has_begun = false;                          // its first profiles are safe
  bool is_counted = false;                         // the disk was looked at
};

Recorder::Recorder(RecorderOptions options, const hal::Clock& clock)
    : options_(std::move(options)), clock_(clock), thread_([this] { Run(); }) {}

Recorder::~Recorder() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

fs::path Recorder::PathOf(const std::string& name) const {
  return options_.directory / (name + ".session");
}

void Recorder::Begin(const std::string& name, Meta meta) {
  {
    const std::lock_guard lock(mutex_);
    open_ = Open::kLeftOut;
    NoGap();
    if (queued_sessions_ >= kMostSessions) {
      ++counters_.dropped_sessions;
      if (!HasMemoryFor([&] { name_ = name; })) {
        counters_.last_error = kNoWords;
        return;
      }
      return Tell("was not recorded: too many sessions wait for the disk, which hangs; check it");
    }
    const bool has_memory = HasMemoryFor([&] {
      name_ = name;
      Item item;
      item.step = Step::kBegin;
      item.name = name;
      item.meta = std::move(meta);
      queue_.push_back(std::move(item));
    });
    if (!has_memory) return CountForMemory(counters_.dropped_sessions);
    open_ = Open::kRecording;
    ++queued_sessions_;
  }
  changed_.notify_one();
}

bool Recorder::HasRoom(std::size_t items) const {
  return open_ == Open::kRecording && queue_.size() < items;
}

void Recorder::LeaveOut(std::uint64_t& left_out, std::uint64_t& counter) {
  if (open_ == Open::kNo) return;
  ++counter;
  if (open_ == Open::kLeftOut) return;  // the session as a whole is told
  if (!std::exchange(gap_for_disk_, true)) {
    Tell("is recorded with gaps: the disk is too slow; check it");
  }
  ++left_out;
}

void Recorder::MissForMemory(std::uint64_t& left_out, std::uint64_t& counter) {
  ++left_out;
  gap_for_memory_ = true;
  CountForMemory(counter);
}

// Of what was to be queued.
void Recorder::CountForMemory(std::uint64_t& counter) {
  ++counter;
  counters_.last_error = kNoWords;
}

void Recorder::QueueGap(std::int64_t t_ns) {
  last_t_ns_ = t_ns;
  if (gap_profiles_ + gap_events_ == 0) return;
  Item item;
  item.step = Step::kGap;
  item.event.kind = hal::ScanEventKind::kGap;
  item.event.t_ns = hal::SaturatingDifference(t_ns, 1);  // events are sorted by time
  // A replay counts the profiles by the first words (cell/scan_state.h).
  std::string what = gap_profiles_ > 0 ? "lost " + std::to_string(gap_profiles_) + " profiles" : "";
  if (gap_events_ > 0) {
    what += (what.empty() ? "" : " and ") + std::to_string(gap_events_) + " events";
  }
  what += ": ";
  if (gap_for_disk_) what += "the disk was too slow";
  if (gap_for_disk_ && gap_for_memory_) what += " and ";
  if (gap_for_memory_) what += "there was no memory";
  item.event.set_detail(what + " for the recorder");
  queue_.push_back(std::move(item));
  NoGap();
}

void Recorder::NoGap() {
  gap_profiles_ = gap_events_ = 0;
  gap_for_disk_ = gap_for_memory_ = false;
}

void Recorder::Add(const hal::LaserProfile& profile) {
  {
    const std::lock_guard lock(mutex_);
    if (!HasRoom(options_.queue_items) ||
        counters_.queued_points + profile.points.size() > options_.queue_points) {
      return LeaveOut(gap_profiles_, counters_.dropped_profiles);
    }
    const bool has_memory = HasMemoryFor([&] {
      QueueGap(profile.t_ns);
      Item item;
      if (!spare_.empty()) {
        item.profile = std::move(spare_.back());
        spare_.pop_back();
      }
      item.profile = profile;
      item.came = clock_.Now();
      queue_.push_back(std::move(item));
    });
    if (!has_memory) return MissForMemory(gap_profiles_, counters_.dropped_profiles);
    counters_.queued_points += profile.points.size();
  }
  changed_.notify_one();
}

void Recorder::Add(const hal::ScanEvent& event) {
  {
    const std::lock_guard lock(mutex_);
    if (!HasRoom(options_.queue_items + kEventRoom)) {
      return LeaveOut(gap_events_, counters_.dropped_events);
    }
    const bool has_memory = HasMemoryFor([&] {
      QueueGap(event.t_ns);
      Item item;
      item.step = Step::kEvent;
      item.event = event;
      queue_.push_back(std::move(item));
    });
    if (!has_memory) return MissForMemory(gap_events_, counters_.dropped_events);
  }
  changed_.notify_one();
}

void Recorder::Finish(Meta meta) {
  Item item;
  item.step = Step::kFinish;
  item.meta = std::move(meta);
  End(std::move(item));
}

void Recorder::Discard() {
  Item item;
  item.step = Step::kDiscard;
  End(std::move(item));
}

// One for each Begin that was queued, so these are bounded as those are.
void Recorder::End(Item item) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(open_, Open::kNo) != Open::kRecording) return;
    const bool has_memory = HasMemoryFor([&] {
      QueueGap(last_t_ns_);
      queue_.push_back(std::move(item));
    });
    // The session ends when the next one begins, as if the process had ended; it can be read.
    if (!has_memory) CountForMemory(counters_.dropped_sessions);
  }
  changed_.notify_one();
}

void Recorder::Flush() {
  std::unique_lock lock(mutex_);
  idle_.wait(lock, [this] { return queue_.empty() && !busy_; });
}

bool Recorder::FlushWithin(std::chrono::nanoseconds patience) {
  std::unique_lock lock(mutex_);
  return idle_.wait_for(lock, patience, [this] { return queue_.empty() && !busy_; });
}

RecorderCounters Recorder::counters() const {
  const std::lock_guard lock(mutex_);
  RecorderCounters counters = counters_;
  counters.queued_items = queue_.size();
  return counters;
}

void Recorder::Run() {
  pthread_setname_np(pthread_self(), "recorder");
  std::unique_ptr<Session> session;
  std::unique_lock lock(mutex_);
  spare_.reserve(kMostSpare);
  for (;;) {
    changed_.wait_for(lock, kLookPeriod, [this] { return stop_ || !queue_.empty(); });
    if (queue_.empty()) {
      if (stop_) break;
      lock.unlock();
      KeepSafe(session);
      LookAtSpace();
      lock.lock();
      continue;
    }
    busy_ = true;
    Item item = std::move(queue_.front());
    queue_.pop_front();
    if (item.step == Step::kBegin) --queued_sessions_;
    lock.unlock();
    WriteOrTell(item, session);
    lock.lock();
    if (item.step == Step::kProfile) {
      counters_.queued_points -= item.profile.points.size();
      if (spare_.size() < kMostSpare) spare_.push_back(std::move(item.profile));
    }
    if (queue_.empty()) {
      lock.unlock();
      KeepSafe(session);
      lock.lock();
    }
    busy_ = false;
    if (queue_.empty()) idle_.notify_all();
  }
}

// SQLite tells want of memory as any error of the disk; all else throws.
void Recorder::WriteOrTell(Item& item, std::unique_ptr<Session>& session) {
  try {
    Write(item, session);
  } catch (const std::bad_alloc&) {
    LeaveOutForMemory(item.step, session);
  }
}

void Recorder::LeaveOutForMemory(Step step, std::unique_ptr<Session>& session) {
  if (session) ++session->dropped;
  const bool ends = step == Step::kFinish || step == Step::kDiscard;
  if (step == Step::kBegin || ends) session.reset();
  const std::lock_guard lock(mutex_);
  if (step == Step::kBegin || step == Step::kFinish) ++counters_.dropped_sessions;
  if (step == Step::kProfile) ++counters_.dropped_profiles;
  if (step == Step::kEvent) ++counters_.dropped_events;
  Tell("is not recorded as a whole: out of memory in the recorder; see what else runs here");
}

// Once everything that came is written: syncs it, if it is the first, or old enough.
void Recorder::KeepSafe(std::unique_ptr<Session>& session) {
  if (!session) return;
  try {
    if (session->oldest &&
        (!session->has_begun || clock_.Now() - *session->oldest >= kCommitInterval)) {
      session->oldest.reset();
      session->has_begun = true;
      if (const auto committed = session->writer.Commit(); !committed) {
        Fail(committed.error().message);
      }
    }
    if (const auto ticked = session->writer.Tick(); !ticked) Fail(ticked.error().message);
    if (!std::exchange(session->is_counted, true)) LookAtDisk();
  } catch (const std::bad_alloc&) {
    LeaveOutForMemory(Step::kGap, session);
  }
}

void Recorder::Write(Item& item, std::unique_ptr<Session>& session) {
  const auto check = [this](const hal::Result<void>& result) {
    if (!result) Fail(result.error().message);
    return result.has_value();
  };
  switch (item.step) {
    case Step::kBegin: {
      session.reset();
      std::error_code error;
      fs::create_directories(options_.directory, error);
      const fs::path path = PathOf(item.name);
      MakeRoom(item.name);
      drivers::SessionWriterOptions options;
      options.commit_interval = kCommitInterval;
      auto writer = drivers::SessionWriter::Create(path.string(), clock_, options);
      if (!writer) {
        Fail(writer.error().message);
      } else {
        session = std::make_unique<Session>(std::move(*writer));
        check(session->writer.SetMeta(item.meta));
      }
      if (!session) LookAtDisk();  // else when its first profiles are safe
      const std::lock_guard lock(mutex_);
      ++(session ? counters_.sessions : counters_.dropped_sessions);
      return;
    }
    case Step::kProfile: {
      if (!session) return;
      const bool written = check(session->writer.Write(item.profile));
      if (!written) ++session->dropped;
      if (!session->oldest) session->oldest = item.came;
      const std::lock_guard lock(mutex_);
      ++(written ? counters_.profiles : counters_.dropped_profiles);
      return;
    }
    case Step::kGap:
      if (session) ++session->dropped;
      [[fallthrough]];
    case Step::kEvent:
      if (session) check(session->writer.Write(item.event));
      return;
    case Step::kFinish:
      if (!session) return;
      item.meta["recording"] = session->dropped == 0 ? "complete" : "incomplete";
      if (check(session->writer.SetMeta(item.meta))) check(session->writer.Finish());
      session.reset();
      LookAtDisk();
      return;
    case Step::kDiscard: {
      if (!session) return;
      const std::string path = session->writer.path();
      session.reset();  // closes the file
      std::error_code error;
      fs::remove(path, error);
      return;
    }
  }
}

void Recorder::MakeRoom(const std::string& name) {
  hal::Result<std::set<std::string>> kept;
  if (options_.kept) kept = options_.kept();
  if (!kept) return Fail(kept.error().message);
  kept->insert(name);
  const auto removed = KeepLimits({options_.directory, options_.results}, options_.limits, *kept,
                                  SystemRetentionWorld());
  if (!removed) return Fail(removed.error().message);
  const std::lock_guard lock(mutex_);
  counters_.removed_sessions += removed->sessions.size();
  counters_.removed_results += removed->results.size();
}

void Recorder::LookAtDisk() {
  const std::uint64_t bytes = BytesOfSessions(options_.directory);
  {
    const std::lock_guard lock(mutex_);
    counters_.sessions_bytes = bytes;
  }
  space_due_ = {};
  LookAtSpace();
}

void Recorder::LookAtSpace() {
  const auto now = clock_.Now();
  if (now < space_due_) return;
  space_due_ = now + kDiskPeriod;
  const std::optional<FreeSpace> free = FreeSpaceAt(options_.directory);
  if (!free) return;
  const std::lock_guard lock(mutex_);
  counters_.free = *free;
  counters_.knows_disk = true;
}

void Recorder::Tell(const char* what) {
  if (!HasMemoryFor([&] { counters_.last_error = PathOf(name_).string() + " " + what; })) {
    counters_.last_error = kNoWords;
  }
}

void Recorder::Fail(const std::string& what) {
  const std::lock_guard lock(mutex_);
  counters_.last_error = what;
}

}  // namespace bendloop::host
