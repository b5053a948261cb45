// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "firmware-host/history/history_search.h"

namespace bendloop::host {

// Rows of the history for people: a table, a line a part.
std::string HistoryText(const std::vector<HistoryRow>& rows, bool colour);
// CSV (RFC 4180) with a line of titles: a line a part.
std::string HistoryCsv(const std::vector<HistoryRow>& rows);
// CSV of every judged number: a line for each length, rotation and angle of each part.
std::string HistoryValuesCsv(const std::vector<HistoryRow>& rows);
// Schema "bendloop.history/1": the rows, each with its bendloop.result/1.
std::string HistoryJson(const std::vector<HistoryRow>& rows);

}  // namespace bendloop::host
