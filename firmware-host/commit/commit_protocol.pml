// SPDX-License-Identifier: Apache-2.0
//
// The commit protocol as commit_protocol.cc does it, against a bender that keeps the rules of
// drivers/README.md, for spin. tests/faults/check_model.sh runs it; README.md says what it shows.
//
// A program is its number; `bends` is the active one. Everything that goes wrong costs one of FAULTS: an exchange lost before
// or after its effect, late or repeated, a torn staging, a journal that cannot be written, a crash
// of ours, a reboot of the bender, a deed of another master.
//
// Three benders that break a rule: IGNORES_NUMBER takes whatever is staged, whatever number was committed (in one
// attempt, without another master: two commits it cannot tell apart), REJECTS_AND_ACTIVATES answers "rejected" to what
// it takes, COPIES_WRONG makes active what was not sent. The void is the old program's rows, and a breach that was seen locks.
//
// holds with: -DFAULTS=3
// holds with: -DFAULTS=4 -DIGNORES_NUMBER
// holds with: -DFAULTS=2 -DREJECTS_AND_ACTIVATES
// holds with: -DFAULTS=2 -DCOPIES_WRONG
// fails with: -DFAULTS=3

#ifdef MUTANT_VOID_WITH_NEW_ROWS
#define IGNORES_NUMBER
#endif
#ifdef MUTANT_LOCK_AFTER_THE_END
#define REJECTS_AND_ACTIVATES
#endif
#ifdef MUTANT_WRONG_COPY_UNLOCKED
#define COPIES_WRONG
#endif
#ifdef IGNORES_NUMBER
#define ATTEMPTS 1
#define FITS(number) (staged != NONE)
#else
#define FITS(number) (staged == number)
#endif

#ifndef FAULTS
#define FAULTS 3
#endif
#ifndef ATTEMPTS
#define ATTEMPTS 2
#endif

#define NONE 0
#define THEIRS 1  // staged and committed by another master, which never takes a number of ours
#define BASE 2    // active at the start
#define NUMBERS 12
#define WRONG_COPY 14  // of a program that was sent: a row is another one
#define OTHER_PART 15  // loaded at the panel: another part, sequence 0

#ifdef COPIES_WRONG
#define SEQUENCE(program) (program == OTHER_PART -> 0 : (program == WRONG_COPY -> wrong_number : program))
#else
#define SEQUENCE(program) (program == OTHER_PART -> 0 : program)
#endif
#define TROUBLE (faults > 0 && !quiet) -> faults--

mtype = { begun, committing, committed, not_committed };

// The bender: `bends` survives a reboot, the rest does not.
byte bends = BASE;
byte wrong_number;  // of WRONG_COPY
byte staged = NONE;
bool staged_torn;
byte commit_register;
byte reply_sequence;
bool accepted;
bool busy;  // it bends

// Our journal, on disk.
bool open;
mtype step;
byte base, next, last_sequence = BASE;

// Under way, to arrive at any time or never.
byte late_stage = NONE;
bool late_commit[NUMBERS];

byte faults = FAULTS;
bool crash, quiet, foreign;

// What has happened, for the claims.
bool was_sent[NUMBERS];
bool was_swapped[NUMBERS];
bool was_denied[NUMBERS];
byte void_with[NUMBERS];  // the program whose rows the void has; NONE: the old one's
bool breach_told, locked;  // locked: in the journal

inline Activate(number) {
  d_step {
    if
    :: number != commit_register ->  // acts on a change of the register only
       commit_register = number;
       accepted = (FITS(number) && staged != SEQUENCE(bends) && bends != OTHER_PART && !busy
#ifndef MUTANT_NO_CRC
                   && !staged_torn
#endif
                  );
       if
       :: accepted ->
          assert(!staged_torn);          // never a mixed program
          assert(!was_swapped[staged]);  // never twice
          assert(!was_denied[staged]);   // "not committed" stays true
          assert(void_with[staged] == NONE || !was_denied[void_with[staged]]);
          was_swapped[staged] = (staged > BASE);
#ifdef COPIES_WRONG
          wrong_number = staged;
          bends = (staged > BASE -> WRONG_COPY : staged);
#else
          bends = staged;
#endif
#ifdef REJECTS_AND_ACTIVATES
          accepted = false;
#endif
#ifndef MUTANT_STAGED_STAYS
          staged = NONE
#endif
       :: else
       fi;
       reply_sequence = number
    :: else
    fi
  }
}

// Reads are answered or not: an answer that comes late meets a closed connection.
inline Read() {
  atomic {
    if
    :: failed = false
    :: TROUBLE; failed = true
    fi
  }
}

inline Stage(number) {
  atomic {
    if
    :: staged = number; staged_torn = false; failed = false
    :: TROUBLE;
       failed = true;
       if
       :: skip
       :: staged = number; staged_torn = false
       :: staged = number; staged_torn = true
       :: late_stage == NONE -> late_stage = number
       fi
    :: TROUBLE; staged = number; staged_torn = true; failed = false
    fi
  }
}

inline Commit(number) {
  atomic {
    assert(!was_sent[number]);
    was_sent[number] = true;
    if
    :: Activate(number); failed = false
    :: TROUBLE;
       failed = true;
       if
       :: skip
       :: Activate(number)
       :: late_commit[number] = true
       fi
    :: TROUBLE; late_commit[number] = true; failed = false
    :: TROUBLE; Activate(number); late_commit[number] = true; failed = false
    fi
  }
}

#define LARGER(a, b) (a > b -> a : b)

// The largest of the active, the answered, the staged number and the journal's, plus 1.
inline Fresh() {
  Read();
  if
  :: failed
  :: else ->
     atomic {
       fresh = LARGER(SEQUENCE(bends), reply_sequence);
#ifndef MUTANT_FORGETFUL
       fresh = LARGER(fresh, last_sequence);
#endif
       fresh = LARGER(fresh, staged);
       fresh++;
       assert(fresh < NUMBERS)
     }
  fi
}

// The end of an attempt; the disk may refuse it, then the attempt stays open.
inline Finish(end) {
  atomic {
    if
    :: end == committed -> assert(was_swapped[next])
    :: else -> assert(bends != next); was_denied[next] = true
    fi;
    if
    :: step = end; open = false
    :: TROUBLE
    fi
  }
}

active proctype Appliance() {
  byte fresh, attempts = ATTEMPTS;
  bool failed, answered, settled;

Start:
  {
    do
    :: open && !quiet -> goto Settle
    :: open && !quiet -> quiet = true
    :: open && quiet -> assert(!settled); settled = true; goto Settle
    :: !open && attempts > 0 && !locked -> attempts--; goto Attempt
    :: !open && attempts > 0 && locked -> attempts = 0
    :: !open -> goto Quiet
    od;

Attempt:
    // The program that bent the part; then state and active once more.
    Read();
    if
    :: failed || busy -> goto Start
    :: else -> base = bends
    fi;
    Read();
    if
    :: failed || busy || bends != base -> goto Start
    :: else
    fi;
    Fresh();
    if
    :: failed -> goto Start
    :: else
    fi;
    assert(!breach_told);  // what was told locks
    atomic { open = true; step = begun; next = fresh; last_sequence = fresh };
    Stage(next);
    if
    :: failed -> Finish(not_committed); goto Start
    :: else
    fi;
    Read();  // back
    if
    :: failed || staged != next || staged_torn -> Finish(not_committed); goto Start
    :: else
    fi;
    Read();
    if
    :: failed || busy || bends != base -> Finish(not_committed); goto Start
    :: else
    fi;
#ifndef MUTANT_COMMIT_FIRST
    if
    :: step = committing
    :: atomic { TROUBLE; Finish(not_committed); goto Start }
    fi;
    Commit(next);
#else
    Commit(next);
    step = committing;
#endif
#ifdef MUTANT_REPEAT
    if
    :: failed -> Commit(next)
    :: else
    fi;
#endif
    do
    :: Read();
       atomic {
         answered = (!failed && reply_sequence == next);
         if
         :: answered && bends == next ->
            if
            :: !accepted -> goto Breach
            :: else -> Finish(committed); goto Start
            fi
#ifdef COPIES_WRONG
         :: answered && bends == WRONG_COPY -> goto WrongCopy
#endif
         :: answered && !accepted && bends == base ->
#ifdef MUTANT_LEAVE_STAGED
            Finish(not_committed);
            goto Start
#else
            goto Settle
#endif
         :: else
         fi
       }
    :: goto Settle  // the time is up
    od;

Breach:
#ifndef MUTANT_LOCK_AFTER_THE_END
    locked = true;
#endif
    atomic { Finish(committed); breach_told = !open };
    locked = true;
    goto Start;

#ifdef COPIES_WRONG
WrongCopy:
#ifndef MUTANT_WRONG_COPY_UNLOCKED
    locked = true;
#endif
    atomic { Finish(not_committed); breach_told = !open };
    goto Start;
#endif

Settle:
    Read();
    if
    :: failed -> goto Start  // unknown
#ifdef COPIES_WRONG
    :: !failed && bends == WRONG_COPY && reply_sequence == next -> goto WrongCopy
#endif
    :: !failed && bends == next && reply_sequence == next && !accepted -> goto Breach
    :: !failed && bends == next && (reply_sequence != next || accepted) ->
       Finish(committed); goto Start
    :: else
    fi;
#ifndef MUTANT_NO_DISARM
    if
    :: step == committing ->
       // Make a commit that is still under way void.
       Fresh();
       if
       :: failed -> goto Start
       :: else
       fi;
       last_sequence = fresh;
#ifdef MUTANT_VOID_WITH_NEW_ROWS
       void_with[fresh] = next;
#endif
       Stage(fresh);
       if
       :: failed -> goto Start
       :: else
       fi;
       Read();
       if
       :: failed -> goto Start
       :: else
       fi
    :: else
    fi;
#endif
    atomic {
      if
      :: bends == next -> Finish(committed)
      :: else -> Finish(not_committed)
      fi
    };
    goto Start;

Quiet:
    skip
  } unless {
    atomic { crash -> crash = false };
    goto Start
  };

  // After the last fault one look at the bender settles everything.
  atomic {
    if
#ifdef IGNORES_NUMBER
    // A commit that comes twice takes the void, too, and brings the old program back.
    :: !foreign && next != NONE -> assert(step == committed || bends != next)
#else
    :: !foreign && next != NONE -> assert((step == committed) == (bends == next))
#endif
    :: else
    fi
  }
}

// The network, the bender's operator and power, and the other master. It may stop at any time.
inline Arrive(number) {
  atomic {
    late_commit[number] ->
    Activate(number);
    if
    :: late_commit[number] = false
    :: TROUBLE  // repeated
    fi
  }
}

active proctype World() {
end:
  do
  :: late_stage != NONE ->
     atomic {
       staged = late_stage;
       late_stage = NONE;
       if
       :: staged_torn = false
       :: staged_torn = true
       fi
     }
  :: Arrive(3)
  :: Arrive(4)
  :: Arrive(5)
  :: Arrive(6)
  :: Arrive(7)
  :: Arrive(8)
  :: Arrive(9)
  :: atomic { !quiet -> busy = !busy }
  :: atomic { TROUBLE; crash = true }
  :: atomic {
       TROUBLE;
       staged = NONE; staged_torn = false; commit_register = 0; reply_sequence = 0;
       accepted = false
     }
  :: atomic { TROUBLE; foreign = true; bends = OTHER_PART; staged_torn = true }
  :: atomic { TROUBLE; foreign = true; bends = BASE }
  :: atomic { TROUBLE; foreign = true; staged = THEIRS; staged_torn = false }
#ifndef IGNORES_NUMBER
  :: atomic { TROUBLE; foreign = true; Activate(THEIRS) }
#endif
  od
}
