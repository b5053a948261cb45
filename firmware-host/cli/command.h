// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <string_view>

#include "hal/error.h"
#include "hal/result.h"

namespace bendloop::host {

// Each command of `bendloop` hooks itself in with a function Add...Command(app, run). When the user
// chose it, parsing sets `run` to what does the work and returns the exit code.
using Run = std::function<int()>;

CLI::App* AddAcknowledgeCommand(CLI::App& app, Run& run);
CLI::App* AddAcceptanceCommand(CLI::App& app, Run& run);
CLI::App* AddCheckCommand(CLI::App& app, Run& run);
CLI::App* AddDemoCommand(CLI::App& app, Run& run);
CLI::App* AddDoctorCommand(CLI::App& app, Run& run);
CLI::App* AddFeaturesCommand(CLI::App& app, Run& run);
CLI::App* AddFirstProgramCommand(CLI::App& app, Run& run);
CLI::App* AddHistoryCommand(CLI::App& app, Run& run);
CLI::App* AddLotCommand(CLI::App& app, Run& run);
CLI::App* AddReconstructCommand(CLI::App& app, Run& run);
CLI::App* AddReplayCommand(CLI::App& app, Run& run);
CLI::App* AddReportCommand(CLI::App& app, Run& run);
CLI::App* AddSimulateCommand(CLI::App& app, Run& run);
CLI::App* AddStatusCommand(CLI::App& app, Run& run);
CLI::App* AddSupportCommand(CLI::App& app, Run& run);
CLI::App* AddUndoCommand(CLI::App& app, Run& run);

// "bendloop: MESSAGE" on stderr; the exit code of the error.
int Report(const hal::Error& error);

// "bendloop: note: TEXT" on stderr, for a person.
void Note(const std::string& text);

// To the file, or to standard output for "-". The exit code: 0, or 4 when it cannot be written.
int WriteOutput(const std::string& path, std::string_view text);

}  // namespace bendloop::host
