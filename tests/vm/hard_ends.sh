#!/bin/sh
# The daemon is ended again and again in the middle of scans and commits, on this machine's own kernel: as
# appliance_resets.sh, many times faster and without its boot, unit and package. Bender and scanner go on.
# usage: hard_ends.sh BUILD ENDS killed|honest|lying [SEED]
#   killed         kill -9, each at another time from the scan's first profile to after the commit
#   honest, lying  the power is cut: the state is an ext4 of its own, on a disk that writes down each write and
#                  flush, and then holds what such a disk does (power_cut.py); root
# After each: nothing is sent by the start, at most one program by the part; at the end a whole part is corrected, and
# journal, history, results and sessions agree. Exits with 77 where it cannot be tried.
set -eu
build=$(realpath "$1")
ends=$2
kind=$3
seed=${4:-1}
here=$(dirname -- "$(realpath "$0")")
# shellcheck source=tests/vm/daemon_cell.sh disable=SC2034,SC2154
. "$here/daemon_cell.sh"

finish() { # hard, in the middle of whatever it does; the disk is then as after it
  cut_ms=$(now_ms)
  if [ "$kind" = killed ]; then
    kill -9 "$daemon"
    wait "$daemon" 2>/dev/null || true
    daemon=
    return 0
  fi
  # Nothing runs on while the disk is dead already.
  kill -STOP "$daemon"
  kill -9 "$storage"
  kill -9 "$daemon"
  wait "$daemon" "$storage" 2>/dev/null || true
  disk_off
  cut=$("$here/power_cut.py" writes before.ext4 "$kind" "$1")
  mv before.ext4 disk.ext4
  daemon=
  disk_on
}

# The journal of a disk that lies may have lost that a commit was sent: what the bender then holds looks like its PLC's
# doing, and corrections are locked until somebody has looked.
look_at_lock() {
  await 120 "what the daemon says" look
  grep -q '^alarm BL4002 ' status.now || return 0
  locked=$((locked + 1))
  "$build/bin/bendloop" acknowledge --config cell.toml >/dev/null || fail "it cannot be acknowledged"
}

now_step="the first part; state: $kind"
machines_on
disk_on
start
ask
was=$sequence
begun=$(now_ms)
bend_and_scan
is_sent() { ask && [ "$sequence" != "$was" ]; }
await 120 "the first correction" is_sent
whole_ms=$(($(now_ms) - begun))
finish "$seed"
judge_session state/sessions
echo "one part: scanned, measured and committed in $whole_ms ms"

resettled=0
locked=0
i=0
while [ "$i" -lt "$ends" ]; do
  i=$((i + 1))
  now_step="end $i of $ends; state: $kind"
  await 120 "a bender that has done all that was sent to it" has_done_all
  ask
  began="$sequence $accepted"
  start
  ask
  judge_start
  ! grep -q '^alarm BL5009' status.now || resettled=$((resettled + 1))
  if [ "$kind" = lying ]; then
    look_at_lock
    # What the ledger lost of the tubes before makes the next one uncertain: it is held (BL3007).
    whole_part
    ask
  fi
  was=$sequence
  taken=$accepted
  bend_and_scan
  delay=$(awk -v chance="$(chance "$seed $i")" -v ms="$whole_ms" 'BEGIN { printf "%.3f", 1.1 * ms / 1000 * chance }')
  sleep "$delay"
  cut=
  finish "$seed$i"
  await 120 "a bender that has done all that was sent to it" has_done_all
  ask
  judge_program
  judge_session state/sessions
  echo "end $i, $delay s after the first profile: sequence $was -> $sequence, $lost_ms ms of its session lost${cut:+; $cut}"
done

now_step="a whole part after the last end; state: $kind"
start
if [ "$kind" = lying ]; then
  look_at_lock
  whole_part
fi
corrected_part
stop

now_step="what is left, looked through; state: $kind"
judge_state state
[ "$locked" = 0 ] || echo "$locked times corrections were locked, and somebody had to look"
echo "$ends ends, $kind: $((ends + 1)) starts, each ready by itself, $resettled settled a commit that was on its way;" \
  "$sent programs sent before the end, none twice; the bender took $accepted, the journal has $committed and none open;" \
  "$results results and $sessions sessions of $part scans, of which an end took $most_lost_ms ms at most; all databases sound"
