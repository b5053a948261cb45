// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/commit/commit_facts.h"

#include "firmware-host/commit/commit_protocol.h"

namespace bendloop::host {
namespace {

std::string ReadBackText(const CommitFacts& facts) {
  switch (facts.read_back) {
    case ReadBack::kNotRead:
      return "not possible";
    case ReadBack::kAsSent:
      return "as sent";
    case ReadBack::kOld:
      return "the old program";
    case ReadBack::kVoid:
      return "the old rows under a number that was never committed";
    case ReadBack::kSpoiled:
    case ReadBack::kOther:
      break;
  }
  return facts.difference;
}

}  // namespace

std::string Describe(const CommitFacts& facts) {
  std::string text = "answer: ";
  if (facts.answer == hal::CommitReply::kNone) text += "none";
  if (facts.answer == hal::CommitReply::kAccepted) text += "accepted";
  if (facts.answer == hal::CommitReply::kRejected) {
    text += "rejected, code " + std::to_string(facts.reply_code);
  }
  text += std::string("; activated: ") + (facts.activated ? "yes" : "no");
  return text + "; read back: " + ReadBackText(facts);
}

std::string ProvenBreach(const CommitFacts& facts) {
  const bool accepted = facts.answer == hal::CommitReply::kAccepted;
  const bool rejected = facts.answer == hal::CommitReply::kRejected;
  if (facts.read_back == ReadBack::kVoid) {
    return "R6: it made a program active whose number was never committed";
  }
  if (facts.activated && !facts.committed) {
    return "R4: it made the staged program active without a commit" +
           (facts.difference.empty() ? "" : ", and changed it: " + facts.difference);
  }
  if (facts.activated && rejected) {
    return "R15: it rejected the program, reply code " + std::to_string(facts.reply_code) +
           ", and made it active all the same" +
           (facts.difference.empty() ? "" : ", changed: " + facts.difference);
  }
  if (facts.read_back == ReadBack::kSpoiled) {
    return std::string("R13: ") + (accepted ? "it accepted the program, but " : "") +
           "what it made active is not what was sent: " + facts.difference;
  }
  if (accepted && facts.read_back == ReadBack::kOld) {
    return "R13: it accepted the program and kept the old one";
  }
  if (facts.answered_early && facts.read_back == ReadBack::kAsSent) {
    return "R13: it accepted the program before it made it active";
  }
  return "";
}

void NoteActive(const hal::ProgramBlock& active, const hal::ProgramBlock& base,
                const hal::ProgramBlock& sent, bool is_void, CommitFacts& facts) {
  facts.difference = FirstDifference(active, sent);
  if (facts.difference.empty()) {
    facts.read_back = ReadBack::kAsSent;
  } else if (active == base) {
    facts.read_back = ReadBack::kOld;
  } else if (is_void) {
    facts.read_back = ReadBack::kVoid;
  } else if (active.sequence == sent.sequence ||
             (active.program == sent.program && active.program != base.program)) {
    facts.read_back = ReadBack::kSpoiled;
  } else {
    facts.read_back = ReadBack::kOther;
  }
  if (facts.read_back == ReadBack::kAsSent || facts.read_back == ReadBack::kSpoiled) {
    facts.activated = true;
  }
}

}  // namespace bendloop::host
