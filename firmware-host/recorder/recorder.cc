// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/recorder/recorder.h"

#include <pthread.h>

#include <system_error>
#include <utility>

#include "drivers/session/session_writer.h"

namespace bendloop::host {

namespace fs = std::filesystem;

namespace {

// With what waits in the queue, and the time that the disk takes, a power cut costs less than the
// last second.
constexpr auto kCommitInterval = std::chrono::milliseconds(500);

}  // namespace

// The file being written.
class Recorder::Session {
 public:
  explicit Session(drivers::SessionWriter w) : writer(std::move(w)) {}
  drivers::SessionWriter writer;
  std::uint64_t dropped = 0;
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
  Item item;
  item.step = Step::kBegin;
  item.name = name;
  item.meta = std::move(meta);
  Push(std::move(item));
}

void Recorder::Add(const hal::LaserProfile& profile) {
  {
    const std::lock_guard lock(mutex_);
    if (counters_.queued_points + profile.points.size() > options_.queue_points) {
      ++counters_.dropped_profiles;
      ++gap_;
      return;
    }
    Item& item = queue_.emplace_back();
    if (!spare_.empty()) {
      item.profile = std::move(spare_.back());
      spare_.pop_back();
    }
    if (gap_ > 0) {
      item.event.kind = hal::ScanEventKind::kGap;
      item.event.t_ns = profile.t_ns;
      item.event.set_detail("recorder left out " + std::to_string(gap_) +
                            " profiles: the disk was too slow");
    }
    gap_ = 0;
    item.profile = profile;
    counters_.queued_points += profile.points.size();
  }
  changed_.notify_one();
}

void Recorder::Add(const hal::ScanEvent& event) {
  Item item;
  item.step = Step::kEvent;
  item.event = event;
  Push(std::move(item));
}

void Recorder::Finish(Meta meta) {
  Item item;
  item.step = Step::kFinish;
  item.meta = std::move(meta);
  Push(std::move(item));
}

void Recorder::Discard() {
  Item item;
  item.step = Step::kDiscard;
  Push(std::move(item));
}

void Recorder::Push(Item item) {
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(std::move(item));
  }
  changed_.notify_one();
}

void Recorder::Flush() {
  std::unique_lock lock(mutex_);
  idle_.wait(lock, [this] { return queue_.empty() && !busy_; });
}

RecorderCounters Recorder::counters() const {
  const std::lock_guard lock(mutex_);
  return counters_;
}

void Recorder::Run() {
  pthread_setname_np(pthread_self(), "recorder");
  std::unique_ptr<Session> session;
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait_for(lock, std::chrono::milliseconds(250),
                      [this] { return stop_ || !queue_.empty(); });
    if (queue_.empty()) {
      if (stop_) break;
      lock.unlock();
      if (session) {
        if (const auto ticked = session->writer.Tick(); !ticked) Fail(ticked.error().message);
      }
      lock.lock();
      continue;
    }
    busy_ = true;
    Item item = std::move(queue_.front());
    queue_.pop_front();
    lock.unlock();
    Write(item, session);
    lock.lock();
    busy_ = false;
    if (item.step == Step::kProfile) {
      counters_.queued_points -= item.profile.points.size();
      if (spare_.size() < 256) spare_.push_back(std::move(item.profile));
    }
    if (queue_.empty()) idle_.notify_all();
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
      const auto removed = KeepDiskBudget(options_.directory, options_.disk_budget_bytes, path);
      drivers::SessionWriterOptions options;
      options.commit_interval = kCommitInterval;
      auto writer = drivers::SessionWriter::Create(path.string(), clock_, options);
      if (!writer) {
        Fail(writer.error().message);
      } else {
        session = std::make_unique<Session>(std::move(*writer));
        check(session->writer.SetMeta(item.meta));
      }
      LookAtDisk();
      const std::lock_guard lock(mutex_);
      counters_.removed_sessions += removed.size();
      if (session) ++counters_.sessions;
      return;
    }
    case Step::kProfile: {
      if (!session) return;
      if (item.event.kind == hal::ScanEventKind::kGap) {
        check(session->writer.Write(item.event));
        ++session->dropped;
      }
      const bool written = check(session->writer.Write(item.profile));
      if (!written) ++session->dropped;
      const std::lock_guard lock(mutex_);
      ++(written ? counters_.profiles : counters_.dropped_profiles);
      return;
    }
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

void Recorder::LookAtDisk() {
  const std::uint64_t bytes = BytesOfSessions(options_.directory);
  std::error_code error;
  const fs::space_info space = fs::space(options_.directory, error);
  const std::lock_guard lock(mutex_);
  counters_.sessions_bytes = bytes;
  if (!error) counters_.free_bytes = space.available;
}

void Recorder::Fail(const std::string& what) {
  const std::lock_guard lock(mutex_);
  counters_.last_error = what;
}

}  // namespace bendloop::host
