#!/bin/sh
# Runs a guest's test and lets tshark, which knows CANopen and ISO-TP from others than us, read the
# frames that it prints in candump's words: is each exchange what we meant?
# usage: dissect_can.sh COMMAND...
# Exits as the command does, or with 1 when tshark reads something else.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM

code=0
"$@" >"$work/out" || code=$?
tr -d '\r' <"$work/out" | grep '^([0-9.]*) ' >"$work/all" || true
grep ' 7E[08]#' "$work/all" >"$work/isotp" || true
grep -v ' 7E[08]#' "$work/all" >"$work/frames" || true
tr -d '\r' <"$work/out" | grep -v '^([0-9.]*) ' || true
[ "$code" = 0 ] || exit "$code"
if ! command -v tshark >/dev/null; then
  echo "############ NOT DISSECTED: tshark is missing; config/install-packages.sh test ############" >&2
  exit 0
fi

# read_frames FILTER FIELD...: the fields of the frames that match, as tshark sees them
read_frames() {
  filter=$1
  shift
  fields=
  for field in "$@"; do fields="$fields -e $field"; done
  # shellcheck disable=SC2086  # the fields are separate words
  tshark -r "$work/frames" -d can.subdissector,canopen -Y "$filter" -T fields -E separator=' ' \
    $fields 2>"$work/errors" || {
    cat "$work/errors" >&2
    exit 1
  }
}
expect() { # WHAT FOUND EXPECTED
  [ "$2" = "$3" ] && return
  echo "dissect_can: $1: tshark reads '$2', expected '$3'" >&2
  exit 1
}
count() { read_frames "$1" frame.number | wc -l; }

total=$(wc -l <"$work/frames")
[ "$total" -gt 500 ] || { echo "dissect_can: only $total frames came" >&2; exit 1; }
expect "frames that are CANopen" "$(count canopen)" "$total"
expect "malformed frames" "$(count '_ws.malformed || _ws.expert')" 0
expect "boot-ups" "$(count 'canopen.nmt_guard.state == 0')" 1
# Segments of a block have no command; what looks like an abort there names no object of ours. That
# time was up (0x05040000) may be said on a machine that has other work.
expect "aborts" "$(count 'canopen.sdo.abort_code && canopen.sdo.abort_code != 0x05040000 && canopen.sdo.main_idx >= 0x1000 &&
  canopen.sdo.main_idx < 0x2100')" 0
# The commit: one write for each program, expedited, and the numbers count up.
expect "commits" "$(read_frames 'canopen.sdo.ccs == 1 && canopen.sdo.main_idx == 0x2001 &&
  canopen.sdo.sub_idx == 1 && canopen.sdo.e == 1' canopen.sdo.data.bytes | tr '\n' ' ')" \
  "02000000 03000000 "
# Rows go as one block, of which tshark tells the kind only: asked and ended, for each program; and
# so does the name of the tube that the PLC is told of, here an empty one.
tshark -r "$work/frames" -d can.subdissector,canopen >"$work/summary" 2>/dev/null
expect "our side of block downloads" "$(grep -c '(rx): Block download' "$work/summary")" 6
expect "the bender's side" "$(grep -c '(tx): Block download' "$work/summary")" 9
# Every question for a value was answered, about the same object.
read_frames 'canopen.cob_id == 0x605 && canopen.sdo.ccs == 2' \
  canopen.sdo.main_idx canopen.sdo.sub_idx >"$work/asked"
read_frames 'canopen.cob_id == 0x585 && canopen.sdo.scs == 2 && canopen.sdo.e == 1 &&
  canopen.sdo.s == 1 && canopen.sdo.main_idx >= 0x1000 && canopen.sdo.main_idx < 0x2100' \
  canopen.sdo.main_idx canopen.sdo.sub_idx >"$work/answered"
[ -s "$work/asked" ]
diff "$work/asked" "$work/answered" >&2
echo "dissect_can: tshark reads $total frames, $(wc -l <"$work/asked") values asked and answered"

# The question that can-utils asked and the bender's answer, each put together from its frames.
tshark -r "$work/isotp" -d can.subdissector,iso15765 -Y iso15765.reassembled.length -T fields \
  -e data.data 2>/dev/null | tail -n 2 | tr '\n' ' ' >"$work/messages"
expect "messages of ISO-TP" "$(cat "$work/messages")" \
  "000500000006010300640002 0005000000070103040000004d "
