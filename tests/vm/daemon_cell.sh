# shellcheck shell=sh disable=SC2034,SC2154
# What hard_ends.sh and bad_times.sh share: a daemon between a simulated bender and scanner, whose state may lie on a disk
# of its own. Sourced, with build and here set, and kind: killed, where the state is a plain
# folder, or any other word.
# Exits with 77 where that cannot be had.
PATH=$PATH:/usr/sbin:/sbin
skip() {
  echo "############ NOT TRIED: $* ############" >&2
  exit 77
}
tools="python3 sqlite3"
[ "$kind" = killed ] || tools="$tools qemu-storage-daemon losetup mke2fs"
for tool in $tools; do
  command -v "$tool" >/dev/null || skip "$tool is missing; config/install-packages.sh test"
done
if [ "$kind" != killed ] && { [ "$(id -u)" != 0 ] || ! [ -w /dev/fuse ] || ! [ -w /dev/loop-control ]; }; then
  skip "a disk of its own needs root, /dev/fuse and loop devices"
fi

work=$(mktemp -d)
bender_program='' scanner_program='' daemon='' storage='' loop=''
daemon_with='' # what the daemon is started by
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  for child in $daemon $bender_program $scanner_program $storage; do kill -9 "$child" 2>/dev/null || true; done
  disk_off
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
fail() {
  echo "$(basename "$0"): $*"
  tail -n 40 "$work/daemon.log" 2>/dev/null || true
  exit 1
}
await() { # await SECONDS WHAT COMMAND...: until it succeeds
  end=$(($(date +%s) + $1))
  what=$2
  shift 2
  until "$@"; do
    [ "$(date +%s)" -lt "$end" ] || fail "$what: not seen"
    sleep 0.05
  done
}
said() { grep -q "$1" "$2"; } # said WORDS FILE
now_ms() { date +%s%3N; }
chance() { echo "$1" | cksum | awk '{ printf "%.4f", $1 % 10000 / 10000 }'; } # chance WORD: of 0 to 1, the same for the same

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
  await 20 "the disk" test -s disk.export
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
# ask: the bender's active sequence, and how many commits it has taken
ask() {
  : >bender.out
  echo status >&3
  await 20 "the bender's answer" said 'accepted [0-9]' bender.out
  sequence=$(sed -n 's/.*sequence \([0-9]*\).*/\1/p' bender.out | head -n 1)
  rows=$(sed -n 's/.*rows \([0-9]*\).*/\1/p' bender.out | head -n 1)
  accepted=$(sed -n 's/.*accepted \([0-9]*\).*/\1/p' bender.out | head -n 1)
}
parts_seen() { status | sed -n 's/^bender parts bent *//p'; }
part=0
part_seen() { [ "$(parts_seen)" = "$part" ]; }
bend() {
  part=$((part + 1))
  tube=tray/part-$(printf %04d "$part").json
  echo bend >&3
  await 20 "part $part on the tray" test -e "$tube"
}
scan() { # returns when the first profiles are on their way
  : >scanner.out
  echo "scan $tube" >&4
  await 60 "scan of part $part" said scanning scanner.out
}
bend_and_scan() {
  bend
  await 20 "part $part, seen by the daemon" part_seen
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
  echo '{"rows": [{"length_mm": 110, "rotation_deg": 0, "angle_deg": 60, "bend_radius_mm": 20},
  {"length_mm": 120, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}' >program.json
  mkfifo bender.in scanner.in
  mkdir tray
  : >bender.out
  : >scanner.out
  "$build/bin/bendloop-simbender" --map "$here/../../config/register-maps/default.toml" --tray tray \
    --program program.json --part-number 7 --pipe-radius 4 --springback-20 1.2 --springback-120 3.6 \
    --elongation 1.5 --scatter-angle 0.3 <bender.in >>bender.out 2>&1 &
  bender_program=$!
  exec 3>bender.in
  "$build/bin/bendloop-simscanner" --spacing 1 --rays 160 --views 2 --rate 600 <scanner.in >>scanner.out 2>&1 &
  scanner_program=$!
  exec 4>scanner.in
  await 20 "bender" said listening bender.out
  await 20 "scanner" said listening scanner.out
  # Each part brings a commit, however small; what is kept is little, so that retention has work.
  cat >cell.toml <<CELL
schema = "bendloop.cell/1"
name = "Hard ends"
part = "$here/one_bend.toml"
state_dir = "$work/state"
[scanner]
kind = "stream"
port = $(sed -n 's/^listening //p' scanner.out)
[bender]
link = "modbus-tcp"
port = $(sed -n 's/^listening //p' bender.out)
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
cd "$work" || exit
