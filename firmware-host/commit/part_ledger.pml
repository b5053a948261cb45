// SPDX-License-Identifier: Apache-2.0
//
// Which tube a scan shows and which program bent it, as the ledger of tubes tells it from what the
// daemon sees of the bender, for spin. tests/faults/check_model.sh runs it; README.md says what it
// shows.
//
// A model of its own, because the product of both would be too large to search. The handshake is
// here what commit_protocol.pml shows it to be: a commit finds the expected program active and
// exchanges it at once, or does nothing; its answer may be lost, and it may come late until it is
// settled.
//
// A program is its number, a tube the bender's count after it was bent. What is called true_ is for
// the claims alone: nothing of ours reads it.
//
// holds with: -DFAULTS=1 -DTUBES=2 -DSCANS=2 -DEDITS=1
// holds with: -DFAULTS=0 -DTUBES=2 -DSCANS=2 -DEDITS=2
// holds with: -DFAULTS=0 -DTUBES=3 -DSCANS=2 -DEDITS=1 -DBETWEEN=1
// holds with: -DFAULTS=0 -DTUBES=4 -DSCANS=2 -DEDITS=1 -DBETWEEN=2
// fails with: -DFAULTS=1 -DTUBES=2 -DSCANS=2 -DEDITS=1

#ifndef TUBES
#define TUBES 3  // are bent
#endif
#ifndef BETWEEN
#define BETWEEN 0  // lie between the bender and the scan
#endif
#ifndef SCANS
#define SCANS 3
#endif
#ifndef EDITS
#define EDITS 2  // at the bender's panel
#endif
#ifndef FAULTS
#define FAULTS 2  // lost or late answers, times without any, restarts of ours
#endif

#define NONE 0
#define BASE 1   // active at the start
#define EDIT 2   // keyed in at the panel; part number and sequence may stay, so they tell nothing
#define OTHER 3  // of another part
#define OURS 4   // the first of our corrections

#define TROUBLE faults > 0 -> faults--
#define LESS(a, b) (a > b -> a - b : 0)

// The bender.
byte bends = BASE;
byte cycle = NONE;      // what it bends with, if it does
byte count;

// The commit under way, to arrive at any time until it is settled, or never.
byte late = NONE;

// The ledger, on disk.
byte seen;              // of the count
byte last = BASE;       // program
byte epoch;             // changes of the program that were not ours
byte bent_with[TUBES + 1];
byte bent_in[TUBES + 1];  // epoch
byte used;              // tubes up to this one are used up, or passed over
byte next = OURS, commit_base, commit_next;
bool open;              // how a commit ended is not known

// The follower of the bender, in memory.
byte known = NONE;    // a cycle that is not counted yet has begun, or will begin, with this
byte running = NONE, running_in;  // and this one is seen to run, in this epoch
bool was_changed = true;
// 1: so much time has passed that anything may have happened; 2: a look has begun since; 0
byte blind = 1;

// On the scanner: the tube that is scanned. What follows is known by the time at which the scan began.
byte true_tube;
bool ended;
byte least, most;     // tubes that were surely bent before it began, and that may have been
bool is_vague;        // `most` is not known yet
// Measured, and not decided.
byte decided_tube, decided_least, decided_most, matched;
bool decided_is_vague;

byte faults = FAULTS, scans = SCANS, edits = EDITS;
byte edit_age;        // 2: no look has begun since the last edit; 1: none has ended; 0
bool crash;

// What has happened, for the claims.
byte true_program[TUBES + 1];
byte true_lineage[TUBES + 1];
// Of the active program: a new one with each change at the panel; a correction has that of what it corrects.
byte lineage, cycle_lineage, commit_lineage, lineages;
bool was_learnt[TUBES + 1];
bool was_sent[TUBES + 1];
byte last_scanned;

inline Activate(number) {
  if
  :: (cycle == NONE
#ifndef MUTANT_BENDER_TAKES_ALL
      && bends != OTHER  // another part is set up
#endif
      ) ->
     assert(bends != OTHER);
     bends = number;
     lineage = commit_lineage
  :: else
  fi
}

// What one look tells: s_* of the state, then `shown`, the active program.
inline Observe() {
  d_step {
    // Nor is it known what was bent while it was not known how a commit ends.
    is_blind = (s_blind || open);
#ifdef MUTANT_OPEN_IS_SEEN
    is_blind = s_blind;
#endif
#ifdef MUTANT_NEVER_BLIND
    is_blind = false;
#endif
    changed = (shown != last);
    ours = (changed && commit_base == last && commit_next == shown);
    bent = s_count - seen;
    i = seen + 1;
    do
    :: i > s_count -> break
    :: else ->
       bent_with[i] = NONE;  // in doubt
       bent_in[i] = epoch;
       if
       :: is_blind
       :: !is_blind && i == seen + 1 && running != NONE ->
          bent_with[i] = running;
#ifndef MUTANT_EPOCH_OF_THE_END
          bent_in[i] = running_in
#endif
       :: else ->
          if
#ifdef MUTANT_NEWEST_PROGRAM
          :: true -> bent_with[i] = shown
#else
          :: !changed && known == shown -> bent_with[i] = shown
#endif
          :: else
          fi
       fi;
       i++
    od;
    seen = s_count;
    if
    :: changed && !ours -> epoch++
    :: else
    fi;
    if
    :: is_blind -> known = NONE
    :: !is_blind && changed ->
       // Ours becomes active between two cycles only. Any other may in the middle of one.
       known = (ours -> shown : NONE);
#ifdef MUTANT_CHANGE_IS_CLEAN
       known = shown
#endif
    :: else ->
       if
       :: !s_bending -> known = shown
       // One cycle has ended, and the next has begun since. The state is older than the program beside it, so
       // the program must have been the same in the look before as well.
       :: (s_bending && bent > 0
#ifndef MUTANT_TORN_LOOK
           && !was_changed
#endif
           ) -> known = shown
       :: else
       fi
    fi;
    if
    :: !s_bending || is_blind -> running = NONE; running_in = 0
    :: else ->
       if
       :: bent > 0 || running == NONE ->
          running = (!changed && known == shown -> shown : NONE);
          running_in = (running != NONE -> epoch : 0)
       :: else
       fi
    fi;
#ifdef MUTANT_NEVER_BLIND
    known = (known == NONE -> shown : known);
#endif
    was_changed = (changed || is_blind);
    last = shown;
    // Of which tubes a scan may be.
    if
    :: true_tube != NONE && !s_in_scan -> least = seen; most = seen
    :: true_tube != NONE && s_in_scan && is_vague -> most = seen; is_vague = false
    :: else
    fi;
    if
    :: decided_tube != NONE && decided_is_vague -> decided_most = seen; decided_is_vague = false
    :: else
    fi;
    blind = (blind == 2 -> 0 : blind);
    edit_age = (edit_age == 1 -> 0 : edit_age);
    // An open commit is settled by whoever sees the bender: commit_protocol.pml.
    open = false;
    late = NONE;
    // Fewer states.
    s_count = 0; s_bending = false; s_blind = false; s_in_scan = false; shown = 0;
    i = 0; bent = 0; is_blind = false; changed = false; ours = false
  }
}

inline ReadState() {
  s_count = count;
  s_bending = (cycle != NONE);
  s_blind = (blind != 0);
  s_in_scan = (true_tube != NONE);
  blind = (blind == 1 -> 2 : blind);
  edit_age = (edit_age == 2 -> 1 : edit_age)
}

inline Look() {
  atomic {
    if
    :: ReadState(); answered = true
    :: TROUBLE; answered = false
    fi
  };
  if
  :: answered ->
     atomic {
       if
       :: shown = bends;
          Observe()
       :: TROUBLE; answered = false
       fi;
       s_count = 0; s_bending = false; s_blind = false; s_in_scan = false; shown = 0
     }
  :: else
  fi
}

// The tube of the scan that is to be decided, if that can be told: `tube`. Else NONE.
inline Match() {
  d_step {
    tube = LESS(decided_most, BETWEEN);
    low = LESS(decided_least, BETWEEN);
    if
#ifndef MUTANT_USES_NOTHING
    :: tube <= used -> tube = NONE  // no new tube
#else
    :: tube == 0 -> tube = NONE
#endif
#ifndef MUTANT_TAKES_THE_LATER
    // The new one was bent about when the scan began: it may be the one scanned before, again.
    :: tube > used && low <= used && used > 0 && low != tube -> tube = NONE
#endif
    :: else ->
       is_certain = (bent_with[tube] != NONE);
#ifndef MUTANT_ANY_UNSCANNED
       i = used + 1;
       do
       :: i >= tube -> break
       :: else -> is_certain = (is_certain && bent_with[i] == bent_with[tube]); i++
       od;
#endif
       if
       :: is_certain
       :: else -> used = tube; tube = NONE  // passed over
       fi
    fi;
    low = 0; i = 0; is_certain = false
  }
}

inline Forget() {
  decided_tube = NONE; decided_least = 0; decided_most = 0; decided_is_vague = false; matched = NONE
}

active proctype Appliance() {
  byte s_count, shown, i, bent, tube, low, program, expected;
  bool s_bending, s_blind, s_in_scan, answered, is_blind, changed, ours, is_certain;

Start:
  {
    do
    :: Look(); answered = false
    :: atomic {
         ended ->
         // A correction that waited is given up: the next part has been measured.
         decided_tube = true_tube; decided_least = least; decided_most = most;
         decided_is_vague = is_vague; matched = NONE;
         last_scanned = true_tube;
         true_tube = NONE; ended = false; least = 0; most = 0; is_vague = false;
         if
         :: skip
         :: Forget()  // held for its own sake: it may be scanned again
         fi
       }
    :: decided_tube != NONE -> goto Decide
    od;

Decide:
    Look();
    if
    :: !answered -> goto Start  // waits
    :: else -> answered = false
    fi;
    if
    :: matched == NONE ->
       atomic {
         Match();
         if
         :: tube == NONE -> Forget(); goto Start
         :: else
         fi;
         program = bent_with[tube];
#ifdef MUTANT_HELD_NOW
         program = last;
#endif
         if
#ifndef MUTANT_ANY_PART
         :: program == OTHER -> Forget(); tube = NONE; program = NONE; goto Start
#endif
         :: else
         fi;
         // Used up on disk before anything is learnt or sent.
         assert(!was_learnt[decided_tube]);
         assert(true_program[decided_tube] == program);
         was_learnt[decided_tube] = true;
#ifndef MUTANT_USES_AFTERWARDS
         used = tube;
#endif
         matched = tube; tube = NONE; program = NONE
       }
    :: else
    fi;
    // What must be active for the correction to be the next program.
    atomic {
      program = bent_with[matched];
#ifdef MUTANT_HELD_NOW
      program = last;
#endif
      expected = (bent_in[matched] == epoch -> last : program);
#ifdef MUTANT_ANY_CHANGE
      expected = last;
#endif
      if
      :: last != expected -> Forget(); expected = NONE; program = NONE; goto Start
      :: last == expected -> skip
      :: Forget(); expected = NONE; program = NONE; goto Start  // nothing to be changed
      fi
    };
    atomic {
      if
#ifndef MUTANT_SENDS_UNSEEN
      :: bends != expected -> Forget(); expected = NONE; program = NONE; goto Start
#endif
      :: cycle != NONE -> expected = NONE; program = NONE; goto Start  // waits
      :: else
      fi;
      // No tube is corrected twice, none against a program that did not bend it, nor on top of somebody's
      // change, and no other part's program is touched.
      assert(!was_sent[decided_tube]);
      assert(true_program[decided_tube] == program);
      assert(true_lineage[decided_tube] == lineage || bends == program);
      assert(bends != OTHER);
      was_sent[decided_tube] = true;
      commit_base = expected; commit_lineage = lineage; commit_next = next; next++; open = true;
#ifdef MUTANT_USES_AFTERWARDS
      tube = matched;
#endif
      Forget(); expected = NONE; program = NONE;
      if
      :: Activate(commit_next);  // and the answer shows it
         ReadState(); shown = bends; open = false; Observe()
      :: TROUBLE
      :: TROUBLE; Activate(commit_next)
      :: TROUBLE; late = commit_next
      fi
#ifdef MUTANT_USES_AFTERWARDS
      ; goto Uses
    };
Uses:
    atomic {
      used = (tube > used -> tube : used); tube = NONE
#endif
    };
    goto Start
  } unless {
    atomic { crash -> crash = false };
    goto Start
  }
}

// Press, setter, operator, network and our power. It may stop at any time.
active proctype World() {
  byte laid;
end:
  do
  :: atomic { cycle == NONE && count < TUBES -> cycle = bends; cycle_lineage = lineage }
  :: atomic {
       cycle != NONE ->
       count++;
       true_program[count] = cycle; true_lineage[count] = cycle_lineage;
       cycle = NONE; cycle_lineage = 0
     }
  // Nobody changes the program twice between two looks, unless there is none for long.
  :: atomic {
       edits > 0 && (edit_age == 0 || blind != 0) ->
       edits--; edit_age = 2; lineages++; lineage = lineages;
       if
       :: bends != OTHER && bends != EDIT -> bends = EDIT
       :: bends != OTHER -> bends = OTHER
       :: bends != BASE -> bends = BASE
       fi
     }
  // The tube that lies so many before the newest, or that of the last scan once more if nothing
  // came of it.
  :: atomic {
       true_tube == NONE && scans > 0 ->
       if
       :: count > BETWEEN -> laid = count - BETWEEN
       :: last_scanned > used && decided_tube == NONE -> laid = last_scanned
       fi;
       scans--;
       true_tube = laid; laid = NONE;
       least = seen; most = seen; is_vague = true
     }
  :: atomic { true_tube != NONE && !ended -> ended = true }
  :: atomic { late != NONE -> Activate(late); late = NONE }
  :: atomic { blind == 0 && TROUBLE; blind = 1 }
  :: atomic {
       TROUBLE;
       crash = true; blind = 1;
       known = NONE; running = NONE; running_in = 0; was_changed = true;
       true_tube = NONE; ended = false; least = 0; most = 0; is_vague = false;
       Forget();
#ifdef MUTANT_FORGETFUL
       used = 0
#endif
     }
  od
}
