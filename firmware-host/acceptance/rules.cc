// SPDX-License-Identifier: Apache-2.0
#include "firmware-host/acceptance/rules.h"

namespace bendloop::host {
namespace {

// The table of drivers/README.md, word by word (tests/unit/acceptance/rules_test.cc).
constexpr std::array<const char*, kRuleCount> kTexts{
    "counts `heartbeat` up at least once a second while its program runs, also at fault",
    "shows in `mode` one of the codes of the map, and idle only when a program may be "
    "exchanged and no cycle runs",
    "stores what is staged exactly, in whatever order and pieces it comes: nothing is "
    "clipped, rounded or judged before the commit",
    "changes the active program for an accepted commit and for the operator only: staging "
    "moves nothing, and a commit of 0 asks for nothing",
    "rejects a commit while `mode` is not idle",
    "rejects a commit that differs from the staged sequence in any bit",
    "rejects a commit of the sequence that is active already",
    "rejects a row count below 2 or above what it can hold",
    "rejects a program whose crc, computed by itself over what is staged, differs from the "
    "staged crc",
    "rejects a value outside the machine's limits: a length below 0, an angle below 0 or of "
    "360 and more, a last row with an angle, and what its own mechanics forbid",
    "rejects a program of another part than the one that is set up",
    "accepts any other, whatever its sequence: numbers are compared for equality and never "
    "for order",
    "copies all rows and the head from staging to active as they are, in one scan cycle, "
    "before it replies",
    "sets the staged sequence to 0 then: a staged program is committed once",
    "leaves the active program alone when it rejects",
    "answers every commit within one scan cycle: `reply_code`, then `reply`, and last "
    "`reply_sequence` := commit",
    "keeps the active program over a power loss; staging and reply may be lost",
    "keeps the active crc right when an operator edits the program at the panel, or sets "
    "sequence and crc both to 0 (\"keyed in\")",
};

}  // namespace

std::string RuleName(Rule rule) { return "R" + std::to_string(static_cast<int>(rule)); }

const char* RuleText(Rule rule) { return kTexts[static_cast<std::size_t>(rule) - 1]; }

}  // namespace bendloop::host
