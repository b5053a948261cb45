// SPDX-License-Identifier: Apache-2.0
//
// A bender without a commit register: what is written is what it bends, and a row count of 0 is all that keeps a
// half-written program from being bent. commit_protocol.cc and register_bender.cc as they do it, for spin;
// README.md says what it shows, drivers/README.md what it means for a cell.
//
// A program is its number; its rows are two pieces that are written one after the other. Each of FAULTS is a
// write or read lost before or after its effect, a write that is answered and not kept, a journal that cannot be written,
// or a crash of ours.
//
// holds with: -DFAULTS=4
// fails with: -DFAULTS=4

#ifndef FAULTS
#define FAULTS 4
#endif

#define OLD 1
#define OTHER 9  // loaded at the panel
#define ATTEMPTS 2
#define TROUBLE (faults > 0) -> faults--

mtype = { begun, committing, committed, not_committed };

// The bender.
byte first = OLD, second = OLD;
bool armed = true;  // the row count is not 0

// Our journal, on disk.
bool open;
mtype step;
byte next = OLD;

byte faults = FAULTS;
bool crash;
bool writing;  // from the first write of an attempt to its end

// With MUTANT_LATE_WRITES: one write that arrives when it likes.
byte late_piece;  // 0: none

inline Write(what, value, piece) {
  atomic {
    if
    :: what = value; failed = false
    :: TROUBLE; failed = true
    :: TROUBLE; failed = true; what = value
    :: TROUBLE; failed = false  // not kept
#ifdef MUTANT_LATE_WRITES
    :: late_piece == 0 && piece != 0 && faults > 0 -> faults--; failed = true; late_piece = piece
#endif
    fi
  }
}

inline Read() {
  atomic {
    if
    :: failed = false
    :: TROUBLE; failed = true
    fi
  }
}

inline Finish(end) {
  atomic {
    writing = false;
    if
    :: end == committed -> assert(armed && first == next && second == next)
    :: else
    fi;
    if
    :: step = end; open = false
    :: TROUBLE
    fi
  }
}

active proctype Appliance() {
  byte attempts = ATTEMPTS;
  bool failed;

Start:
  {
    do
    :: open -> goto Settle
    // A disabled program is nobody's base: somebody loads one first.
    :: !open && attempts > 0 && armed -> attempts--; goto Attempt
    :: !open -> goto Quiet
    od;

Attempt:
    Read();
    if
    :: failed || !armed -> goto Start
    :: else
    fi;
    atomic { open = true; step = begun; next++; writing = true };
#ifndef MUTANT_ARMED_MEANWHILE
    Write(armed, false, 0);
    if
    :: failed -> goto Settle
    :: else
    fi;
#ifndef MUTANT_NOT_SEEN
    Read();  // that it took the row count of 0 is seen before any row is written
    if
    :: failed || armed -> goto Settle
    :: else
    fi;
#endif
#endif
    Write(first, next, 1);
    if
    :: failed -> goto Settle
    :: else
    fi;
    Write(second, next, 2);
    if
    :: failed -> goto Settle
    :: else
    fi;
#ifndef MUTANT_NO_READ_BACK
    Read();
    if
    :: failed || first != next || second != next -> goto Settle
    :: else
    fi;
#endif
    if
    :: step = committing
    :: TROUBLE -> goto Settle
    fi;
    Write(armed, true, 0);

Settle:
    Read();
    if
    :: failed -> goto Start  // unknown
    :: else
    fi;
    atomic {
      if
      :: armed && first == next && second == next -> Finish(committed)
      :: else -> Finish(not_committed)
      fi
    };
    goto Start;

Quiet:
    skip
  } unless {
    atomic { crash -> crash = false };
    goto Start
  }
}

active proctype World() {
end:
  do
  :: atomic { armed -> assert(first == second) }  // a cycle: it never bends a mixture
  :: atomic { TROUBLE; crash = true }
  :: atomic {
#ifdef MUTANT_LOADED_MEANWHILE
       faults > 0 -> faults--;
#else
       faults > 0 && !writing -> faults--;
#endif
       first = OTHER; second = OTHER; armed = true
     }
#ifdef MUTANT_LATE_WRITES
  :: atomic { late_piece == 1 -> first = next; late_piece = 0 }
  :: atomic { late_piece == 2 -> second = next; late_piece = 0 }
#endif
  od
}
