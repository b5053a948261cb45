// SPDX-License-Identifier: Apache-2.0
#include "drivers/simulated_bender/misbehaviour.h"

#include <cmath>
#include <map>
#include <sstream>
#include <string>

namespace bendloop::drivers {
namespace {

using Answer = Misbehaviour::Answer;

constexpr unsigned kMaxDelayMs = 600000;

// "late, ack-late, silent, ...": the first word of each line of the help.
std::string Verbs() {
  std::istringstream lines{std::string(MisbehaviourHelp())};
  std::string verbs;
  for (std::string line, verb; std::getline(lines, line); verbs += verb) {
    std::istringstream(line) >> verb;
    if (!verbs.empty()) verbs += ", ";
  }
  return verbs;
}

}  // namespace

std::string_view MisbehaviourHelp() {
  return "  late MS            do and answer every request MS milliseconds later\n"
         "  ack-late MS        handle a commit MS milliseconds after it was written\n"
         "  silent             neither do nor answer anything\n"
         "  mute               do everything, answer nothing\n"
         "  exception N        answer with Modbus exception N (CANopen: abort 0x08000020 + N)\n"
         "  garbage            answer noise\n"
         "  short              answer half an answer\n"
         "  wrong-unit         answer as another unit\n"
         "  wrong-transaction  answer another transaction (RTU: function, CANopen: object)\n"
         "  drop-after-stage   hang up on the next commit without doing it\n"
         "  drop-after-commit  do the next commit, then hang up\n"
         "  away-after-commit  do the next commit, then be silent\n"
         "  half-write         keep only half of the next write to the staging area\n"
         "  reject N           reject the next commit with reply code N\n"
         "  reboot             hang up, forget staging and reply, be not ready for a cycle time\n"
         "  other-program      an operator loads another program\n"
         "  edit DEG           an operator adds DEG to the first bend at the panel\n"
         "  set-count N        the count of tubes jumps to N\n"
         "  lying-rows         the active row count says more rows than there are\n"
         "  refuse-report      refuse what the PLC is to read of the cell (Modbus)\n"
         "  freeze             the heartbeat stands still\n"
         "  mode MODE          idle, not-ready, bending or fault\n"
         "  break RULE         break a rule of the PLC, as listed below; several may be broken\n"
         "  behave             none of these any more\n";
}

// A table. NOLINTNEXTLINE(readability-function-size)
hal::Result<MisbehaviourCommand> ParseMisbehaviour(std::string_view command, Misbehaviour& now) {
  std::istringstream words{std::string(command)};
  std::string verb;
  words >> verb;
  MisbehaviourCommand result;

  const auto bad = [&](const std::string& expected) {
    return hal::Fail(hal::ErrorKind::kUsage, "misbehave \"" + std::string(command) +
                                                 "\": expected " + expected + "; the faults are " +
                                                 Verbs());
  };
  unsigned number = 0;
  const auto number_up_to = [&](unsigned max) { return words >> number && number <= max; };

  static const std::map<std::string, Answer> kAnswers{
      {"silent", Answer::kSilent},        {"mute", Answer::kMute},
      {"garbage", Answer::kGarbage},      {"short", Answer::kShort},
      {"wrong-unit", Answer::kWrongUnit}, {"wrong-transaction", Answer::kWrongTransaction}};
  static const std::map<std::string, bool Misbehaviour::*> kFlags{
      {"half-write", &Misbehaviour::half_write},
      {"drop-after-stage", &Misbehaviour::drop_after_stage},
      {"drop-after-commit", &Misbehaviour::drop_after_commit},
      {"away-after-commit", &Misbehaviour::away_after_commit},
      {"refuse-report", &Misbehaviour::refuse_report},
      {"freeze", &Misbehaviour::freeze}};
  static const std::map<std::string, MisbehaviourEvent> kEvents{
      {"reboot", MisbehaviourEvent::kReboot},
      {"other-program", MisbehaviourEvent::kOtherProgram},
      {"lying-rows", MisbehaviourEvent::kLyingRows}};
  static const std::map<std::string, hal::BenderMode> kModes{
      {"idle", hal::BenderMode::kIdle},
      {"not-ready", hal::BenderMode::kNotReady},
      {"bending", hal::BenderMode::kBending},
      {"fault", hal::BenderMode::kFault}};

  if (const auto answer = kAnswers.find(verb); answer != kAnswers.end()) {
    now.answer = answer->second;
  } else if (const auto flag = kFlags.find(verb); flag != kFlags.end()) {
    now.*flag->second = true;
  } else if (const auto event = kEvents.find(verb); event != kEvents.end()) {
    result.event = event->second;
  } else if (verb == "late" || verb == "ack-late") {
    if (!number_up_to(kMaxDelayMs)) return bad("a delay of 0 to 600000 ms");
    (verb == "late" ? now.late : now.acknowledge_late) = std::chrono::milliseconds(number);
  } else if (verb == "exception") {
    if (!number_up_to(127) || number == 0) return bad("an exception code of 1 to 127");
    now.answer = Answer::kException;
    now.exception = static_cast<std::uint8_t>(number);
  } else if (verb == "reject") {
    if (!number_up_to(65535) || number == 0) return bad("a reply code of 1 to 65535");
    now.reject_code = number;
  } else if (verb == "edit") {
    if (!(words >> result.angle_deg) || !(std::abs(result.angle_deg) <= 90)) {
      return bad("an angle of -90 to 90 degrees");
    }
    result.event = MisbehaviourEvent::kEdit;
  } else if (verb == "set-count") {
    if (!number_up_to(4'000'000'000u)) return bad("a count of 0 to 4000000000");
    result.event = MisbehaviourEvent::kSetCount;
    result.count = number;
  } else if (verb == "mode") {
    std::string name;
    words >> name;
    const auto mode = kModes.find(name);
    if (mode == kModes.end()) return bad("idle, not-ready, bending or fault");
    result.event = MisbehaviourEvent::kMode;
    result.mode = mode->second;
  } else if (verb == "break") {
    std::string name;
    words >> name;
    const auto mutant = FindRuleMutant(name);
    if (!mutant) return bad("the name of a broken rule (bendloop-simbender --help lists them)");
    now.broken.Add(*mutant);
  } else if (verb == "behave") {
    now = {};
  } else {
    return bad("a fault from the list");
  }
  if (std::string rest; words >> rest) return bad("nothing after \"" + verb + "\"");
  return result;
}

}  // namespace bendloop::drivers
