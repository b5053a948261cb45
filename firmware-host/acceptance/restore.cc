// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/restore.h"

#include <algorithm>
#include <string>
#include <system_error>
#include <utility>

#include "firmware-host/console/output_file.h"
#include "firmware-host/console/whole_file.h"
#include "firmware-host/result/json.h"
#include "firmware-host/result/json_reader.h"

namespace bendloop::host {
namespace {

constexpr const char* kSchema = "bendloop.acceptance-restore/1";
constexpr const char* kMend =
    "; the program that was found is not active: bring the machine to idle and run 'bendloop "
    "acceptance --restore', or load the program at the panel and remove the file";
// Sequences that are tried before the program at the panel is the last resort.
constexpr int kTries = 3;

hal::Result<void> NotRestored(const std::string& why) {
  return hal::Fail(hal::ErrorKind::kDevice, why + kMend);
}

// Empty: it was accepted, or there is no telling; the active program says.
std::string CommitOnce(Plc& plc, const RegisterProgram& program, const RestoreOptions& options) {
  if (!plc.Commit(0) || !plc.Stage(program)) return "";
  const auto staged = plc.Staged(program.words.size() / plc.form().stride());
  if (!staged) return "";
  if (const auto differs = Difference(plc.map(), *staged, program); !differs.empty()) {
    return "staging " + differs;
  }
  if (!plc.Commit(program.sequence)) return "";
  const auto end = plc.clock().Now() + options.reply_timeout;
  while (plc.clock().Now() < end) {
    const auto active = plc.Active();
    const auto state = plc.State();
    if (!active || !state) return "";
    if (*active == program) return "";
    if (state->reply_sequence == program.sequence && state->reply == plc.map().reply_rejected) {
      return "the bender rejects it, reply code " + std::to_string(state->reply_code);
    }
    plc.clock().SleepFor(options.poll_period);
  }
  return "the bender does not take it";
}

// What is staged can be committed by nobody, and nothing is asked.
void MakeVoid(Plc& plc, RegisterProgram program) {
  program.sequence = 0;
  program.crc = 0;
  if (plc.Stage(program)) plc.Commit(0);
}

}  // namespace

hal::Result<void> RestoreFile::Keep(const RegisterProgram& found, const std::string& bender) const {
  const Json json = {{"schema", kSchema},
                     {"bender", bender},
                     {"part_number", found.part_number},
                     {"sequence", found.sequence},
                     {"row_count", found.row_count},
                     {"crc", found.crc},
                     {"registers", found.words}};
  return WriteOutputFile(file_, Dump(json, 2) + "\n");
}

hal::Result<std::optional<RegisterProgram>> RestoreFile::Read() const {
  std::error_code error;
  if (!std::filesystem::exists(file_, error) && !error) return std::optional<RegisterProgram>();
  const auto text = ReadWholeFile(file_);
  if (!text) return hal::Fail(text.error());
  const Json json = Json::parse(*text, nullptr, false);
  std::optional<hal::Error> wrong;
  const JsonReader reader(json, file_.string(), wrong);
  if (reader.At("schema").Text() != kSchema) reader.At("schema").WrongText(kSchema);
  RegisterProgram found{reader.At("part_number").Count32(),
                        reader.At("sequence").Count32(),
                        reader.At("row_count").Count32(),
                        reader.At("crc").Count32(),
                        {}};
  const JsonReader words = reader.At("registers");
  for (std::size_t i = 0, n = words.Size(drivers::kAddressSpaceSize); i < n; ++i) {
    found.words.push_back(static_cast<std::uint16_t>(words.Item(i).Count32()));
  }
  if (wrong) {
    wrong->kind = hal::ErrorKind::kBadInput;
    wrong->message += "; look at the bender's program yourself, then remove the file";
    return hal::Fail(*wrong);
  }
  return std::optional<RegisterProgram>(std::move(found));
}

hal::Result<void> RestoreFile::Remove() const {
  std::error_code error;
  std::filesystem::remove(file_, error);
  if (!error) return {};
  return hal::Fail(hal::ErrorKind::kDevice,
                   file_.string() + ": cannot be removed: " + error.message());
}

bool IsRestored(Plc& plc, const RegisterProgram& active, const RegisterProgram& found) {
  if (active == found) return true;
  RegisterProgram renumbered = found;
  renumbered.sequence = active.sequence;
  renumbered.crc = plc.form().Crc(renumbered);
  return active == renumbered;
}

hal::Result<void> RestoreProgram(Plc& plc, const RegisterProgram& found,
                                 const RestoreOptions& options) {
  std::string why;
  for (int i = 0; i < kTries; ++i) {
    const auto active = plc.Active();
    const auto state = plc.State();
    if (!active || !state) break;
    const bool keyed_in = found.sequence == 0;
    if (*active == found || ((keyed_in || i > 0) && IsRestored(plc, *active, found))) {
      MakeVoid(plc, found);
      if (plc.trouble()) break;
      return {};
    }
    if (state->mode != plc.map().mode_idle) return NotRestored("the bender is not idle");
    RegisterProgram program = found;
    if (keyed_in || i > 0) {
      const auto staged = plc.Staged(0);
      if (!staged) break;
      const std::uint32_t last =
          std::max({active->sequence, state->reply_sequence, staged->sequence, found.sequence});
      program.sequence = last >= plc.max_sequence() ? 1 : last + 1;
      program.crc = plc.form().Crc(program);
    }
    why = CommitOnce(plc, program, options);
    if (plc.trouble()) break;
  }
  const auto trouble = plc.TakeTrouble();
  return NotRestored(trouble ? trouble->text : "bender " + plc.Name() + ": " + why);
}

}  // namespace bendloop::host
