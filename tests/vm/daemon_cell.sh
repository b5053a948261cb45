# shellcheck shell=sh disable=SC2034,SC2154
# What hard_ends.sh and bad_times.sh share: a daemon between a simulated bender and scanner, whose state may lie on a disk
# of its own. Sourced, with build and here set, and kind: killed, where the state is a plain
# folder, or any other word.
# Exits with 77 where that cannot be had.
rate=600
log=daemon.log
# shellcheck source=tests/vm/machines.sh
. "$here/machines.sh"
[ "$kind" = killed ] || need qemu-storage-daemon losetup mke2fs
if [ "$kind" != killed ] && { [ "$(id -u)" != 0 ] || ! [ -w /dev/fuse ] || ! [ -w /dev/loop-control ]; }; then
  skip "a disk of its own needs root, /dev/fuse and loop devices"
fi

daemon='' storage='' loop=''
filler='' # what fills its disk (bad_times.sh)
daemon_with='' # what the daemon is started by
# shellcheck disable=SC2317  # called by the trap
tell_more() {
  # What the script had stopped would keep `status` waiting.
  for child in $storage $bender_program $scanner_program; do kill -CONT "$child" 2>/dev/null; done
  echo "-- what the daemon says:"
  status | grep -E '^(alarm|state|problem|bender|scan session|last part)' | cut -c 1-200
  kill -0 "$daemon" 2>/dev/null || echo "nothing: it does not run"
}
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  code=$?
  set +e
  tell_end "$code"
  for child in $filler $daemon $storage; do kill -9 "$child" 2>/dev/null; done
  machines_off
  disk_off
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT

disk_on() { # the state's folder is there
  [ "$kind" != killed ] || { mkdir -p state; return 0; }
  : >writes
  : >disk.export
  # The image as it is now, to put the writes on that a disk would have kept.
  cp --sparse=always disk.ext4 before.ext4
  qemu-storage-daemon --blockdev file,node-name=image,filename="$work/disk.ext4" \
    --blockdev file,node-name=log,filename="$work/writes" --blockdev blklogwrites,node-name=disk,file=image,log=log \
    --export fuse,id=export,node-name=disk,mountpoint="$work/disk.export",writable=on >>storage.log 2>&1 &
  storage=$!
  await 120 "the disk" test -s disk.export
  loop=$(losetup -f --show disk.export) || fail "there is no loop device for the disk"
  mkdir -p state
  mount -t ext4 "$loop" state || fail "the disk cannot be mounted: $(dmesg | tail -n 5)"
}
disk_off() {
  if mountpoint -q "$work/state"; then umount "$work/state" 2>/dev/null || umount -l "$work/state"; fi
  [ -z "$loop" ] || losetup -d "$loop" 2>/dev/null || true
  loop=
  [ -z "$storage" ] || { kill "$storage" && wait "$storage"; } 2>/dev/null || true
  storage=
  # The loop device may let go a moment later; where nothing is mounted, nothing is to be done.
  umount "$work/disk.export" 2>/dev/null || umount -l "$work/disk.export" 2>/dev/null || true
}
status() { timeout 30 "$build/bin/bendloop" status --config cell.toml 2>/dev/null; }
# look: what the daemon says, in status.now; false: it did not answer
look() { status >status.now; }
says() { grep -q "^$1\$" status.now; } # says LINE: of the last look
is_ready() { look && says 'state  *waiting for a scan'; }
start() {
  # shellcheck disable=SC2086  # separate words
  $daemon_with "$build/bin/bendloopd" --config cell.toml --status-port 0 >>daemon.log 2>&1 &
  daemon=$!
  await 120 "a daemon that waits for a scan" is_ready
  ! grep -E '^alarm BL501[01] ' status.now || [ "$kind" = lying ] || fail "a database is damaged"
}
part_seen() { look && says "bender parts bent  *$part"; }
bend_and_scan() {
  bend
  await 120 "part $part, seen by the daemon" part_seen
  scan
}
# A scan is over when the daemon says of it what became of it; results and alarms come at other times: what a disk did
# not take is written later, and what a part before left over ends with the next one.
last_told() { sed -n 's/^last part session  *//p' status.now; }
note_told() { # before a scan: which one it told of last
  await 120 "what the daemon says" look
  told=$(last_told)
}
is_told() { # it tells of another one, and waits for the next
  is_ready && now_told=$(last_told) && [ -n "$now_told" ] && [ "$now_told" != "$told" ]
}
whole_part() {
  note_told
  bend_and_scan
  await 120 "what became of part $part" is_told
}
# Nothing is on its way: no scan, and no correction that waits for the bender or whose end is not known.
is_at_rest() { is_ready && ! grep -q '^alarm BL\(3017\|4001\|4009\) ' status.now; }
has_taken() { ask && [ "$accepted" -ge "$1" ]; }
# await_commits N: the bender has taken so many, and takes no more. A correction may have to wait for a bender that did not
# answer in time, so it need not be there when its part is.
await_commits() {
  await 120 "commit $1 (the bender had taken $accepted)" has_taken "$1"
  await 120 "a daemon with nothing on its way" is_at_rest
  ask
  [ "$accepted" = "$1" ] || fail "the bender has taken $accepted commits instead of $1"
}
# corrected_part: one part, one commit
corrected_part() {
  await 120 "a daemon with nothing on its way" is_at_rest
  ask
  due=$((accepted + 1))
  whole_part
  await_commits "$due"
}
stop() { # the daemon, well
  await 120 "a daemon with nothing on its way" is_at_rest
  kill "$daemon"
  wait "$daemon" || fail "the daemon did not stop well: $?"
  daemon=
}

machines_on() { # and the cell's file, and an empty disk
  bender_on
  scanner_on 0
  # Each part brings a commit, however small; what is kept is little, so that retention has work.
  cat >cell.toml <<CELL
schema = "bendloop.cell/1"
name = "Hard ends"
part = "$here/one_bend.toml"
state_dir = "$work/state"
[scanner]
kind = "stream"
port = $(port_of scanner)
[bender]
link = "modbus-tcp"
port = $(port_of bender)
register_map = "$here/../../config/register-maps/default.toml"
# A bender that other work of this machine keeps waiting is not away.
response_timeout_ms = 2000
commit_timeout_ms = 10000
[scan]
max_seconds = 600 # one that is held (machines.sh) is not given up
[correction]
deadband_sigmas = 0
[record]
disk_budget_mb = 16
[storage]
min_free_mb = 16
CELL
  if [ "$kind" != killed ]; then
    truncate -s 512M disk.ext4
    mke2fs -q -t ext4 disk.ext4
  fi
}
