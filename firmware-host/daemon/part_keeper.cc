// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/part_keeper.h"

#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdio>
#include <ctime>
#include <utility>
#include <vector>

#include "firmware-host/report/report.h"
#include "firmware-host/result/result_json.h"
#include "firmware-host/text/result_text.h"

namespace bendloop::host {
namespace {

// Parts that the report shows beside each other.
constexpr std::size_t kReportParts = 20;

}  // namespace

std::string UtcNow() {
  const auto now = std::chrono::system_clock::now();
  const std::time_t seconds = std::chrono::system_clock::to_time_t(now);
  const auto ms =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000;
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[64];
  const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text + length, sizeof text - length, ".%03dZ", static_cast<int>(ms));
  return text;
}

PartKeeper::PartKeeper(StateStore& store, std::filesystem::path sessions, std::string lot_key)
    : store_(store), sessions_(std::move(sessions)), lot_key_(std::move(lot_key)) {}

hal::Result<void> PartKeeper::Load() {
  auto history = History::Open(store_.history());
  if (!history) return hal::Fail(history.error());
  history_.emplace(std::move(*history));
  auto lot = store_.Lot(lot_key_);
  if (!lot) return hal::Fail(lot.error());
  lot_ = std::move(*lot);
  if (lot_) spdlog::info("lot goes on: {} parts so far", lot_->parts);
  return {};
}

ScanIdentity PartKeeper::Identify() const { return {store_.NextName(sessions_), UtcNow()}; }

void PartKeeper::Keep(PartOutcome outcome) {
  const RunResult& result = outcome.result;
  if (outcome.next) {
    lot_ = outcome.next;
    if (auto kept = store_.KeepLot(*lot_, lot_key_); !kept) {
      spdlog::error("lot not kept: {}", kept.error().message);
    }
  }
  const auto path = store_.results() / (result.session + ".json");
  if (auto written = WriteFileAtomically(path, WriteResultJson(result)); !written) {
    spdlog::error("result not kept: {}", written.error().message);
  }
  if (auto added = history_->Add(result); !added) {
    spdlog::error("history not kept: {}", added.error().message);
  }
  std::string verdict = VerdictLine(result, false);
  while (!verdict.empty() && verdict.back() == '\n') verdict.pop_back();
  spdlog::info("{}: {}", result.session, verdict);
  for (const std::string& reason : outcome.reasons) {
    spdlog::warn("{}: {}", result.session, reason);
  }
  if (result.bender && result.bender->outcome == CommitOutcome::kCommitted) {
    spdlog::info("{}: bender confirmed program {}", result.session, result.bender->sequence);
  }
  recent_.push_back(std::move(outcome.result));
  if (recent_.size() > kReportParts) recent_.pop_front();
  WriteReport();
}

void PartKeeper::WriteReport() {
  // Beside the loop: the next scan may begin while the page is made. One at a time; a part that
  // comes meanwhile is in the next page, and Flush writes the last one.
  if (report_.valid() && report_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    report_late_ = true;
    return;
  }
  report_late_ = false;
  report_ = std::async(
      std::launch::async,
      [path = store_.report(), runs = std::vector<RunResult>(recent_.begin(), recent_.end())] {
        if (auto written = WriteFileAtomically(path, ReportHtml(runs)); !written) {
          spdlog::error("report not written: {}", written.error().message);
        }
      });
}

void PartKeeper::Flush() {
  if (report_.valid()) report_.wait();
  if (!report_late_) return;
  WriteReport();
  report_.wait();
}

void PartKeeper::KeepFailure(const FailedScan& failed) {
  spdlog::warn("{}: not measured: {}", failed.identity.session, failed.error.message);
}

}  // namespace bendloop::host
