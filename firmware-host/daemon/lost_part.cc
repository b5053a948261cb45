// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/daemon/lost_part.h"

#include "drivers/session/session_reader.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/result/result_json.h"

namespace bendloop::host {

RunResult LostPart(const PartFiles& files, const std::string& session, const CommitReport& report) {
  const auto text = ReadWholeFile(files.result);
  if (auto kept = text ? ReadResultJson(*text, files.result.string()) : hal::Fail(text.error())) {
    const bool is_known = kept->bender && kept->bender->outcome != CommitOutcome::kUnknown &&
                          kept->bender->outcome != CommitOutcome::kWaiting;
    if (!is_known) kept->bender = report;
    return std::move(*kept);
  }
  RunResult lost;
  lost.session = session;
  lost.bender = report;
  lost.measurement.warnings = {
      "the daemon ended before what it had measured was kept: 'bendloop replay' of the session "
      "measures it again"};
  if (const auto recording = drivers::SessionReader::Open(files.session.string())) {
    lost.part = recording->MetaOr("part", "");
    lost.time = recording->MetaOr("start", "");
    lost.software = recording->MetaOr("software", "");
    lost.identity = recording->MetaOr("identity", "");
  }
  return lost;
}

}  // namespace bendloop::host
