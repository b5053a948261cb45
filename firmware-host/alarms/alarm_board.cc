// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/alarms/alarm_board.h"

#include <algorithm>

namespace bendloop::host {

void AlarmBoard::BeginNow(AlarmCode code, const std::string& detail) {
  for (Alarm& alarm : active_) {
    if (alarm.code != code) continue;
    alarm.detail = detail;
    return;
  }
  active_.push_back({code, detail, unix_ms_(), 0, 0});
  const auto known = std::find_if(counts_.begin(), counts_.end(),
                                  [code](const auto& count) { return count.first == code; });
  known == counts_.end() ? counts_.emplace_back(code, 1).second : ++known->second;
  if (listener_) listener_(active_.back());
}

void AlarmBoard::EndAt(std::size_t at) {
  Alarm alarm = std::move(active_[at]);
  active_.erase(active_.begin() + static_cast<std::ptrdiff_t>(at));
  // Not before it began, whatever somebody did to the clock.
  alarm.ended_ms = std::max(unix_ms_(), alarm.began_ms);
  if (listener_) listener_(alarm);
  recent_.push_back(std::move(alarm));
  if (recent_.size() > kRecent) recent_.pop_front();
}

void AlarmBoard::Begin(AlarmCode code, const std::string& detail) {
  const std::lock_guard lock(mutex_);
  BeginNow(code, detail);
}

void AlarmBoard::End(AlarmCode code) {
  if (KindOf(code).end == AlarmEnd::kAcknowledged) return;
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < active_.size(); ++i) {
    if (active_[i].code == code) return EndAt(i);
  }
}

void AlarmBoard::SetOfPart(const std::vector<std::pair<AlarmCode, std::string>>& now) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = active_.size(); i-- > 0;) {
    const AlarmCode code = active_[i].code;
    const bool goes_on = std::any_of(now.begin(), now.end(),
                                     [code](const auto& alarm) { return alarm.first == code; });
    if (!goes_on && KindOf(code).end == AlarmEnd::kNextPart) EndAt(i);
  }
  for (const auto& [code, detail] : now) BeginNow(code, detail);
}

void AlarmBoard::Acknowledge() {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = active_.size(); i-- > 0;) {
    ++active_[i].acknowledged;
    if (KindOf(active_[i].code).end != AlarmEnd::kCause) EndAt(i);
  }
}

bool AlarmBoard::IsActive(AlarmCode code) const {
  const std::lock_guard lock(mutex_);
  return std::any_of(active_.begin(), active_.end(),
                     [code](const Alarm& alarm) { return alarm.code == code; });
}

std::vector<Alarm> AlarmBoard::Active() const {
  std::vector<Alarm> alarms;
  {
    const std::lock_guard lock(mutex_);
    alarms = active_;
  }
  std::stable_sort(alarms.begin(), alarms.end(), [](const Alarm& a, const Alarm& b) {
    return KindOf(a.code).severity > KindOf(b.code).severity;
  });
  return alarms;
}

std::vector<Alarm> AlarmBoard::Recent() const {
  const std::lock_guard lock(mutex_);
  return {recent_.begin(), recent_.end()};
}

std::uint64_t AlarmBoard::Count(AlarmCode code) const {
  const std::lock_guard lock(mutex_);
  for (const auto& [known, count] : counts_) {
    if (known == code) return count;
  }
  return 0;
}

}  // namespace bendloop::host
