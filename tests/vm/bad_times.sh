#!/bin/sh
# What goes wrong around a daemon that works: each trouble is named by an alarm, survived, and its alarm ends by itself
# when the cause goes, in one process; but for a read-only disk, which Linux gives back by a new mount only.
# usage: bad_times.sh BUILD           needs root; exits with 77 where it cannot be tried
set -eu
if [ -z "${BAD_TIMES:-}" ]; then # a network of its own, whose loopback can go away
  if [ "$(id -u)" != 0 ] || ! command -v busybox >/dev/null; then
    echo "############ NOT TRIED: root and busybox are needed; config/install-packages.sh test ############" >&2
    exit 77
  fi
  BAD_TIMES=1 exec unshare --net "$0" "$@"
fi
busybox ip link set lo up
build=$(realpath "$1")
kind=honest
here=$(dirname -- "$(realpath "$0")")
# shellcheck source=tests/vm/daemon_cell.sh disable=SC2034,SC2154
. "$here/daemon_cell.sh"
alarmed() { look && grep -q "^alarm $1 " status.now; }
alarm_ended() { look && ! grep -q "^alarm $1 " status.now; }
told() { # told CODE: it is active
  await 120 "alarm $1" alarmed "$1"
  sed -n "s/^\(alarm $1 .*\)/   \1/p" status.now | cut -c 1-150
}
ended() { for code in "$@"; do await 120 "end of alarm $code" alarm_ended "$code"; done; }
is_held() { look && says "scan profiles  *$held_profiles"; }
middle_of_scan() { # of the next tube; the scan stays there until go_on
  note_told
  bend
  await 120 "part $part, seen by the daemon" part_seen
  scan_held
  await 120 "the middle of the scan" is_held
}
end_of_scan() { await 120 "what became of part $part" is_told; }
# result_kept: of the scan that was told of last; what a full disk did not take is written when it takes something again
result_kept() { [ -s "state/results/$now_told.json" ]; }
same_process() { kill -0 "$daemon" 2>/dev/null || fail "the daemon ended"; }
# fill COMMAND...: until it fails
fill() { while "$@"; do :; done; }
# fill_up: the disk, to its last block, in larger pieces first
fill_up() {
  [ -e state/fill ] || : >state/fill
  for piece in $((16 << 20)) $((4 << 20)) $((1 << 20)) $((1 << 18)) $((1 << 16)) $((1 << 14)) $((1 << 12)); do
    while fallocate -o "$(stat -c %s state/fill)" -l "$piece" state/fill 2>/dev/null; do :; done
  done
}
next_file() {
  files=$((files + 1))
  touch "state/fill/$files" 2>/dev/null
}

# set_clock SECONDS: the daemon's wall clock is off by so much
set_clock() { python3 -c 'import struct, sys; open("clock", "r+b").write(struct.pack("<q", int(sys.argv[1])))' "$1"; }

head -c 8 /dev/zero >clock
cc -shared -fPIC -O1 -o set_clock.so "$here/set_clock.c" || skip "no C compiler"
daemon_with="env LD_PRELOAD=$work/set_clock.so SET_CLOCK=$work/clock"
machines_on
# Few names, so that they run out soon.
mke2fs -q -F -t ext4 -N 256 disk.ext4
disk_on
start
corrected_part

step "The disk full in the middle of a scan"
fallocate -l $(($(df --output=avail -B 1 state | tail -n 1) - (32 << 20))) state/ballast
middle_of_scan
fill_up
# And stays full, whatever is given back; on that disk alone: where this script fails, it would else fill another.
touch filling
while [ -e filling ] && mountpoint -q state; do
  fill_up
  sleep 0.01
done >/dev/null 2>&1 &
filler=$!
go_on
told BL5006
end_of_scan
# A recording that is cut short gives back what it had, in which a result may have room, before it is filled again. The
# tube's next passes find none from their begin.
passes=1
until alarmed BL5001; do
  # In this order: it may be written after the alarm was looked for, and then the alarm is over.
  result_kept || alarmed BL5001 || fail "the result of $now_told is not there, and nothing says so"
  passes=$((passes + 1))
  [ "$passes" -le 5 ] || fail "$passes passes of a tube, and each found room for its result on a full disk"
  note_told
  scan
  end_of_scan
done
told BL5001
unkept=$now_told
same_process
rm filling
wait "$filler"
filler=
rm state/fill state/ballast
corrected_part
corrected_part
ended BL5006 BL5001 BL5002 BL5003 BL5005 BL5012
now_told=$unkept
await 120 "the result of $unkept, now that there is room" result_kept

step "No inodes left"
mkdir state/fill
files=0
fill next_file
whole_part
for code in BL5005 BL5006; do told "$code"; done
unkept=$now_told
same_process
rm -r state/fill
corrected_part
corrected_part
ended BL5001 BL5002 BL5003 BL5005 BL5006 BL5012
now_told=$unkept
await 120 "the result of $unkept, now that there is room" result_kept

step "The disk hangs for 4 s in the middle of a scan"
ask
due=$((accepted + 1))
middle_of_scan
kill -STOP "$storage"
go_on
sleep 4
kill -CONT "$storage"
await_commits "$due"
same_process
corrected_part

step "No more memory, in the middle of a scan"
# Of a daemon that has not yet what a scan needs: it keeps what it has once had. No more address space than it has.
stop
start
middle_of_scan
prlimit --pid "$daemon" --as=1:unlimited
go_on
told BL5015
same_process
prlimit --pid "$daemon" --as=unlimited:unlimited
corrected_part
corrected_part
ended BL5015 BL5001 BL5002 BL5003 BL5004 BL5005 BL5012 BL1001
same_process

step "The bender dead, in the middle of a scan: it answers nothing"
ask
due=$((accepted + 1))
middle_of_scan
kill -STOP "$bender_program"
told BL4001
go_on
end_of_scan
told BL3017
sleep 5
kill -CONT "$bender_program"
ended BL4001 BL3017
# Its correction has waited for the bender, and must not be counted with the next part's.
await_commits "$due"
same_process
corrected_part
grep -c 'bender does not answer' daemon.log | sed 's/$/ lines in the log/'

step "The scanner dead, in the middle of a scan"
middle_of_scan
scanner_port=$(sed -n '/\[scanner\]/,/\[bender\]/s/^port = //p' cell.toml)
kill -9 "$scanner_program"
wait "$scanner_program" 2>/dev/null || true
for code in BL1001 BL1003; do told "$code"; done
scanner_on "$scanner_port"
ended BL1001
same_process
corrected_part
ended BL1003

step "No network"
busybox ip link set lo down
told BL4001
told BL1001
busybox ip link set lo up
ended BL4001 BL1001
same_process
corrected_part

step "The clock set a year ahead, two years back, and a year ahead"
for years in 1 -1 0; do
  set_clock $((years * 31536000))
  told BL5014
  corrected_part
  ended BL5014
done
same_process

step "The disk read-only, as ext4 does it after an error"
mount -o remount,abort state
note_told
bend
told BL5012 # the tube cannot be counted
scan
end_of_scan
told BL5001
same_process
kill "$daemon"
wait "$daemon" || true
await 120 "the disk, unmounted" umount state
mount -t ext4 "$loop" state || fail "the disk cannot be mounted again"
start
# Held: the ledger lost a tube, and what bent the next one is not certain (BL3007).
whole_part
corrected_part
ended BL5001 BL5002 BL5003 BL5005 BL5012
stop

step "What all that left, looked through"
judge_state state
step "done: $part scans, $accepted programs taken, all of them in the journal; all databases sound"
