// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <string>
#include <utility>

#include "firmware-host/history/history.h"
#include "firmware-host/ledger/moment.h"

namespace bendloop::host {

hal::Result<void> History::NoteAlarm(const Alarm& alarm) {
  return database_.Transact("noting an alarm", [&]() -> hal::Result<void> {
    auto note = database_.Prepare(
        "INSERT INTO alarm(code, severity, text, detail, began, ended) VALUES(?, ?, ?, ?, ?, ?)"
        " ON CONFLICT(code, began) DO UPDATE SET detail = excluded.detail, ended = excluded.ended");
    if (!note) return hal::Fail(note.error());
    const AlarmKind& kind = KindOf(alarm.code);
    note->Bind(static_cast<std::int64_t>(alarm.code))
        .Bind(std::string(Name(kind.severity)))
        .Bind(std::string(kind.sentence))
        .Bind(alarm.detail)
        .Bind(UtcText(alarm.began_ms));
    alarm.is_active() ? note->BindNull() : note->Bind(UtcText(alarm.ended_ms));
    if (auto done = database_.Run(*note, "noting an alarm"); !done) return done;
    // Ids have gaps: who began and who ended take one each.
    auto drop = database_.Prepare(
        "DELETE FROM alarm WHERE id <"
        " (SELECT min(id) FROM (SELECT id FROM alarm ORDER BY id DESC LIMIT ?))");
    if (!drop) return hal::Fail(drop.error());
    drop->Bind(
        static_cast<std::int64_t>(std::clamp<std::size_t>(options_.most_alarms, 1, 1'000'000'000)));
    return database_.Run(*drop, "dropping old alarms");
  });
}

hal::Result<void> History::EndAlarms(std::int64_t now_ms) {
  auto end = database_.Prepare("UPDATE alarm SET ended = ? WHERE ended IS NULL");
  if (!end) return hal::Fail(end.error());
  end->Bind(UtcText(now_ms));
  return database_.Run(*end, "ending alarms");
}

hal::Result<std::vector<Alarm>> History::LastAlarms(std::size_t count) const {
  auto select =
      database_.Prepare("SELECT code, detail, began, ended FROM alarm ORDER BY id DESC LIMIT ?");
  if (!select) return hal::Fail(select.error());
  select->Bind(static_cast<std::int64_t>(std::min<std::size_t>(count, 1'000'000)));
  std::vector<Alarm> alarms;
  auto outcome = drivers::Statement::Outcome::kRow;
  while ((outcome = select->Step()) == drivers::Statement::Outcome::kRow) {
    Alarm alarm;
    alarm.code = static_cast<AlarmCode>(select->Integer(0));
    alarm.detail = select->Text(1);
    alarm.began_ms = ParseUtc(std::string(select->Text(2))).value_or(0);
    alarm.ended_ms = ParseUtc(std::string(select->Text(3))).value_or(0);
    alarms.push_back(std::move(alarm));
  }
  if (outcome == drivers::Statement::Outcome::kFailed) {
    return hal::Fail(database_.Failed("reading alarms"));
  }
  std::reverse(alarms.begin(), alarms.end());
  return alarms;
}

}  // namespace bendloop::host
