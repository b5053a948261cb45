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
began_s=$(date +%s)
step() { echo "== [$(($(date +%s) - began_s)) s] $*"; }
alarmed() { status | grep -q "^alarm $1 "; }
alarm_ended() { status >alarms.now && ! grep -q "^alarm $1 " alarms.now; }
told() { # told CODE: it is active, within a minute
  await 60 "alarm $1" alarmed "$1"
  status | sed -n "s/^\(alarm $1 .*\)/   \1/p" | cut -c 1-150
}
ended() { for code in "$@"; do await 60 "end of $code" alarm_ended "$code"; done; }
corrected_part() {
  ask
  was=$accepted
  whole_part
  ask
  [ "$accepted" = $((was + 1)) ] || fail "$was commits became $accepted"
}
confirmed() { grep -c 'bender confirmed program' daemon.log; }
is_confirmed() { [ "$(confirmed)" -gt "$1" ]; }
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
bend_and_scan
# What is left is filled while the scanner waits, so before the scan is over, however busy this machine is.
kill -STOP "$scanner_program"
fill_up
# And stays full, whatever is given back; on that disk alone: where this script fails, it would else fill another.
touch filling
while [ -e filling ] && mountpoint -q state; do
  fill_up
  sleep 0.01
done >/dev/null 2>&1 &
filler=$!
kill -CONT "$scanner_program"
told BL5006
await 60 "the end of the scan" said '^scanned' scanner.out
# A recording that is cut short gives back what it had, in which a result may have room. The tube's second pass finds none
# from its begin.
scan
told BL5001
same_process
rm filling
wait "$filler"
filler=
rm state/fill state/ballast
await 60 "the daemon ready" is_ready
corrected_part
corrected_part
ended BL5006 BL5001 BL5002 BL5003 BL5005 BL5012

step "No inodes left"
mkdir state/fill
files=0
fill next_file
bend_and_scan
for code in BL5005 BL5006; do told "$code"; done
same_process
rm -r state/fill
await 60 "the daemon ready" is_ready
corrected_part
corrected_part
ended BL5001 BL5002 BL5003 BL5005 BL5006 BL5012

step "The disk hangs for 4 s in the middle of a scan"
ask
was=$accepted
bend_and_scan
kill -STOP "$storage"
sleep 4
kill -CONT "$storage"
is_sent() { ask && [ "$accepted" = $((was + 1)) ]; }
await 60 "the correction" is_sent
same_process
await 60 "the daemon ready" is_ready
corrected_part

step "No more memory, in the middle of a scan"
# Of a daemon that has not yet what a scan needs: it keeps what it has once had. No more address space than it has.
kill "$daemon"
wait "$daemon" || fail "it did not stop well"
start
bend_and_scan
prlimit --pid "$daemon" --as=1:unlimited
told BL5015
same_process
prlimit --pid "$daemon" --as=unlimited:unlimited
await 60 "the daemon ready" is_ready
corrected_part
corrected_part
ended BL5015 BL5001 BL5002 BL5003 BL5004 BL5005 BL5012 BL1001
same_process

step "The bender dead, in the middle of a scan: it answers nothing"
bend_and_scan
confirmed_before=$(confirmed)
kill -STOP "$bender_program"
told BL4001
sleep 5
kill -CONT "$bender_program"
ended BL4001
# Its correction has waited for the bender, and must not be counted with the next part's.
await 60 "the program of the part that was scanned, confirmed" is_confirmed "$confirmed_before"
same_process
await 60 "the daemon ready" is_ready
corrected_part
grep -c 'bender does not answer' daemon.log | sed 's/$/ lines in the log/'

step "The scanner dead, in the middle of a scan"
bend_and_scan
scanner_port=$(sed -n '/\[scanner\]/,/\[bender\]/s/^port = //p' cell.toml)
kill -9 "$scanner_program"
wait "$scanner_program" 2>/dev/null || true
told BL1001
scanner_on "$scanner_port"
ended BL1001
same_process
await 60 "the daemon ready" is_ready
corrected_part

step "No network"
busybox ip link set lo down
told BL4001
told BL1001
busybox ip link set lo up
ended BL4001 BL1001
same_process
await 60 "the daemon ready" is_ready
corrected_part

step "The clock set a year ahead, two years back, and a year ahead"
for years in 1 -1 0; do
  set_clock $((years * 31536000))
  told BL5014
  corrected_part
done
ended BL5014
same_process

step "The disk read-only, as ext4 does it after an error"
mount -o remount,abort state
bend
told BL5012 # the tube cannot be counted
scan
told BL5001
sleep 1
same_process
ask
was=$accepted
kill "$daemon"
wait "$daemon" || true
umount state
mount -t ext4 "$loop" state
start
# Held: the ledger lost a tube, and what bent the next one is not certain (BL3007).
whole_part
corrected_part
ended BL5001 BL5002 BL5003 BL5005 BL5012
kill "$daemon"
wait "$daemon" || fail "it did not stop well"
daemon=
for database in state/*.db state/sessions/*.session; do
  [ "$(sqlite3 "$database" 'PRAGMA integrity_check')" = ok ] || fail "$database is not sound"
done
committed=$(sqlite3 state/journal.db "SELECT count(*) FROM step WHERE step = 'committed'")
[ "$committed" = "$accepted" ] || fail "the bender took $accepted commits, the journal knows of $committed"
step "done: $part scans, $accepted programs taken, all of them in the journal; all databases sound"
