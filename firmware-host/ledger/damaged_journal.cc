// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/ledger/damaged_journal.h"

#include "drivers/sqlite/damaged_file.h"
#include "firmware-host/commit/commit_journal.h"
#include "firmware-host/ledger/ledger_store.h"

namespace bendloop::host {
namespace {

namespace fs = std::filesystem;

// Of the newest tubes: as many as a scan is ever matched with, and more.
constexpr std::size_t kTubesLookedAt = 1000;

// Of a row that SQLite gives, and that is none of ours; "" where the file cannot be opened, which
// whoever opens it next is told.
std::string NonsenseIn(const fs::path& path) {
  const auto of = [](const auto& read) {
    const bool is_bad = !read && read.error().kind == hal::ErrorKind::kBadInput;
    return is_bad ? read.error().message : std::string();
  };
  const auto journal = CommitJournal::Open(path);
  if (!journal) return "";
  if (std::string bad = of(journal->Last()); !bad.empty()) return bad;
  const auto ledger = LedgerStore::Open(path);
  if (!ledger) return "";
  if (std::string bad = of(ledger->LastChange()); !bad.empty()) return bad;
  return of(ledger->Tubes(kTubesLookedAt));
}

}  // namespace

hal::Result<std::optional<fs::path>> SetDamagedJournalAside(const fs::path& journal,
                                                            std::int64_t unix_ms) {
  std::string damage = drivers::DamageOf(journal);
  std::error_code error;
  if (damage.empty() && fs::exists(journal, error)) damage = NonsenseIn(journal);
  if (damage.empty()) return std::nullopt;
  auto aside = drivers::MoveAside(journal, unix_ms);
  if (!aside) return hal::Fail(aside.error());
  return std::optional<fs::path>(std::move(*aside));
}

hal::Result<void> LockForDamagedJournals(const fs::path& journal) {
  const auto files = drivers::MovedAside(journal);
  if (files.empty()) return {};
  auto opened = CommitJournal::Open(journal);
  if (!opened) return hal::Fail(opened.error());
  for (const fs::path& file : files) {
    const std::string name = file.filename().string();
    if (auto noted = opened->NoteBreach(name, kJournalWasDamaged + name); !noted) return noted;
  }
  return {};
}

}  // namespace bendloop::host
