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
cleanup() {
  for child in $filler $daemon $storage; do kill -9 "$child" 2>/dev/null || true; done
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
  await 60 "the disk" test -s disk.export
  loop=$(losetup -f --show disk.export)
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
status() { "$build/bin/bendloop" status --config cell.toml 2>/dev/null; }
is_ready() { status | grep -q '^state  *waiting for a scan$'; }
start() {
  # shellcheck disable=SC2086  # separate words
  $daemon_with "$build/bin/bendloopd" --config cell.toml --status-port 0 >>daemon.log 2>&1 &
  daemon=$!
  await 60 "a daemon that waits for a scan" is_ready
  ! status | grep -E '^alarm BL501[01] ' || [ "$kind" = lying ] || fail "a database is damaged"
}
parts_seen() { status | sed -n 's/^bender parts bent *//p'; }
part_seen() { [ "$(parts_seen)" = "$part" ]; }
bend_and_scan() {
  bend
  await 60 "part $part, seen by the daemon" part_seen
  scan
}
results() { find state/results -name '*.json' | wc -l; }
has_more_results() { [ "$(results)" -gt "$1" ]; }
whole_part() {
  before=$(results)
  bend_and_scan
  await 60 "result of part $part" has_more_results "$before"
  await 60 "the daemon ready again" is_ready
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
