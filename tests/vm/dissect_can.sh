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
expect_all() { # WHAT FOUND EXPECTED: more only where something was said once more
  if [ "$stood_still" != 0 ] && [ "$2" -gt "$3" ]; then return; fi
  expect "$@"
}
count() { read_frames "$1" frame.number | wc -l; }

total=$(wc -l <"$work/frames")
[ "$total" -gt 500 ] || { echo "dissect_can: only $total frames came" >&2; exit 1; }
expect "frames that are CANopen" "$(count canopen)" "$total"
expect "malformed frames" "$(count '_ws.malformed || _ws.expert')" 0
expect "boot-ups" "$(count 'canopen.nmt_guard.state == 0')" 1
# Where the whole machine stood still for as long as an answer may take (500 ms; the daemon asks each 250), whoever
# waited asks or sends once more, ends what was on its way, and writes its report from the start. Nowhere else.
stood_still=$(awk '{ at = substr($1, 2) + 0; late += NR > 3 && at - before > 0.45; before = at } END { print late + 0 }' \
  "$work/frames")
[ "$stood_still" = 0 ] || echo "dissect_can: the machine stood still $stood_still times: what was said once more is left out"
# Segments of a block have no command; what looks like an abort there names no object of ours. That time was up
# (0x05040000), or that a segment came that was sent once more (0x05040001), is said after standing still alone.
repeated=
[ "$stood_still" = 0 ] || repeated='&& canopen.sdo.abort_code != 0x05040000 && canopen.sdo.abort_code != 0x05040001'
expect "aborts" "$(count "canopen.sdo.abort_code $repeated && canopen.sdo.main_idx >= 0x1000 &&
  canopen.sdo.main_idx < 0x2100")" 0
# The commit: one write for each program, expedited, and the numbers count up.
expect "commits" "$(read_frames 'canopen.sdo.ccs == 1 && canopen.sdo.main_idx == 0x2001 &&
  canopen.sdo.sub_idx == 1 && canopen.sdo.e == 1' canopen.sdo.data.bytes | tr '\n' ' ')" \
  "02000000 03000000 "
# Rows go as one block for each program, and so does the name of the tube that the PLC is told of, here an empty
# one. Of a block tshark tells the kind only: asked and ended by us; granted, taken and confirmed by the bender.
awk '{ print substr($3, 1, 14) }' "$work/frames" >"$work/begins"
rows=$(grep -c '^605#C[26]212000' "$work/begins" || true)
names=$(grep -c '^605#C[26]312005' "$work/begins" || true)
expect_all "rows that began as a block" "$rows" 2
expect_all "names that began as a block" "$names" 1
tshark -r "$work/frames" -d can.subdissector,canopen >"$work/summary" 2>/dev/null
expect_all "our side of block downloads" "$(grep -c '(rx): Block download' "$work/summary")" 6
expect_all "the bender's side" "$(grep -c '(tx): Block download' "$work/summary")" 9
# Every question for a value was answered, about the same object.
read_frames 'canopen.cob_id == 0x605 && canopen.sdo.ccs == 2' \
  canopen.sdo.main_idx canopen.sdo.sub_idx >"$work/asked"
read_frames 'canopen.cob_id == 0x585 && canopen.sdo.scs == 2 && canopen.sdo.e == 1 &&
  canopen.sdo.s == 1 && canopen.sdo.main_idx >= 0x1000 && canopen.sdo.main_idx < 0x2100' \
  canopen.sdo.main_idx canopen.sdo.sub_idx >"$work/answered"
[ -s "$work/asked" ]
diff "$work/asked" "$work/answered" >"$work/unlike" || true
[ "$stood_still" = 0 ] || sed -i '/^</d; /^[0-9]/d' "$work/unlike"
expect "questions whose answer is another's" "$(cat "$work/unlike")" ""
echo "dissect_can: tshark reads $total frames, $(wc -l <"$work/asked") values asked and answered"

# The question that can-utils asked and the bender's answer, each put together from its frames.
tshark -r "$work/isotp" -d can.subdissector,iso15765 -Y iso15765.reassembled.length -T fields \
  -e data.data 2>/dev/null | tail -n 2 | tr '\n' ' ' >"$work/messages"
expect "messages of ISO-TP" "$(cat "$work/messages")" \
  "000500000006010300640002 0005000000070103040000004d "
