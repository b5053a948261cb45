#!/bin/sh
# The appliance's power is cut again and again in the middle of scans and commits: the packages in a Debian
# under qemu, which is killed; its disk keeps what a disk keeps then (power_cut.py). Scanner and bender are
# the host's, and go on.
# usage: appliance_resets.sh BUILD CACHE [RESETS [honest|lying]]      (default: 2 honest)
# Needs root for the guest's disk. Exits with 77 where it cannot be tried.
set -eu
build=$(realpath "$1")
cache=$2
resets=${3:-2}
disk_kind=${4:-honest}
here=$(dirname -- "$(realpath "$0")")
PATH=$PATH:/usr/sbin:/sbin
for tool in python3 sqlite3 debugfs; do
  command -v "$tool" >/dev/null || {
    echo "############ NOT TRIED: $tool is missing; config/install-packages.sh test ############" >&2
    exit 77
  }
done
work=$(mktemp -d)
children=
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  [ ! -s "$work/qemu.pid" ] || kill -9 "$(cat "$work/qemu.pid")" 2>/dev/null || true
  # shellcheck disable=SC2086  # process numbers
  kill $children 2>/dev/null || true
  if mountpoint -q "$work/root/proc"; then umount "$work/root/proc"; fi
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
step() { echo "== $*"; }
fail() {
  echo "appliance_resets: $*"
  tail -n 60 "$work/console" 2>/dev/null || true
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

cache=$(realpath "$cache")
image=$("$here/appliance_image.sh" "$build" "$cache" "$work")
disk=$work/disk.ext4
cd "$work"

step "A bender and a scanner that nobody resets"
echo '{"rows": [{"length_mm": 110, "rotation_deg": 0, "angle_deg": 60, "bend_radius_mm": 20},
  {"length_mm": 120, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}' >program.json
mkfifo bender.in scanner.in
mkdir tray
: >bender.out
: >scanner.out
"$build/bin/bendloop-simbender" --map "$here/../../config/register-maps/default.toml" --tray tray \
  --program program.json --part-number 7 --pipe-radius 4 --springback-20 1.2 --springback-120 3.6 \
  --elongation 1.5 --scatter-angle 0.3 <bender.in >>bender.out 2>&1 &
children=$!
exec 3>bender.in
"$build/bin/bendloop-simscanner" --spacing 1 --rays 160 --views 2 --rate 200 <scanner.in >>scanner.out 2>&1 &
children="$children $!"
exec 4>scanner.in
await 20 "bender" said listening bender.out
await 20 "scanner" said listening scanner.out

step "Installed on the guest's disk, with a cell that has these"
root=$work/root
mkdir "$root"
tar -C "$root" -xf "${image%.ext4}.tar"
mount -t proc proc "$root/proc"
cp "$work"/packages/bendloop_*.deb "$root/root"
inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive "$@" </dev/null; }
inside sh -c 'cd /root && apt-get -q -y install ./bendloop_*.deb' >install.log 2>&1 || fail "$(cat install.log)"
cp "$here/one_bend.toml" "$root/etc/bendloop/parts"
# A guest in software is slow: its times are longer than a cell's.
cat >"$root/etc/bendloop/cell.toml" <<CELL
schema = "bendloop.cell/1"
name = "Power cuts"
part = "parts/one_bend.toml"
[scanner]
kind = "stream"
host = "10.0.2.2"
port = $(sed -n 's/^listening //p' scanner.out)
[bender]
link = "modbus-tcp"
host = "10.0.2.2"
port = $(sed -n 's/^listening //p' bender.out)
register_map = "register-maps/default.toml"
connect_timeout_ms = 3000
response_timeout_ms = 3000
commit_timeout_ms = 10000
[correction]
# Each part brings a commit, however small.
deadband_sigmas = 0
CELL
inside bendloop check /etc/bendloop/cell.toml || fail "the cell is wrong"
mkdir -p "$root/etc/systemd/system/bendloopd.service.d"
inside bendloop check --unit-drop-in /etc/bendloop/cell.toml >"$root/etc/systemd/system/bendloopd.service.d/50-cell.conf"
inside systemctl enable bendloopd >install.log 2>&1 || fail "$(cat install.log)"
umount "$root/proc"
mke2fs -q -t ext4 -d "$root" "$disk" 2G >install.log 2>&1 || fail "$(cat install.log)"
rm -rf --one-file-system "$root"

# ask: the bender's active sequence, and how many commits it has taken
ask() {
  : >bender.out
  echo status >&3
  await 20 "the bender's answer" said 'accepted [0-9]' bender.out
  sequence=$(sed -n 's/.*sequence \([0-9]*\).*/\1/p' bender.out | head -n 1)
  rows=$(sed -n 's/.*rows \([0-9]*\).*/\1/p' bender.out | head -n 1)
  accepted=$(sed -n 's/.*accepted \([0-9]*\).*/\1/p' bender.out | head -n 1)
}
boot() { # boot FILE...: the guest runs, with these taken along
  : >console
  rm -f qemu.pid
  GUEST_DISK=$disk GUEST_DISK_STAYS=1 GUEST_WRITES=$work/writes GUEST_NET=1 GUEST_PID=$work/qemu.pid \
    GUEST_MEMORY_MB=768 GUEST_CPUS=1 GUEST_SECONDS=900 \
    "$here/run_guest.sh" "$cache" "" "$here/reset_guest.sh" "$here/guest_service.sh" "$@" >console 2>&1 &
  guest=$!
  await 600 "the service in the guest" said 'guest: \(ready\|failed\)' console
  said 'guest: ready' console || fail "the service is not ready"
  ! said 'guest: damaged' console || [ "$disk_kind" = lying ] || fail "a database is damaged"
  grep '^guest: ' console | tr -d '\r'
}
part=0
scan() { # bends a part and scans it; returns when the first profiles are on their way
  part=$((part + 1))
  tube=tray/part-$(printf %04d "$part").json
  echo bend >&3
  await 20 "part $part on the tray" test -e "$tube"
  sleep 1 # the daemon looks at the bender twice a second
  : >scanner.out
  echo "scan $tube" >&4
  await 60 "scan of part $part" said scanning scanner.out
}
power_off() { # kills the guest; its disk then holds what such a disk does
  kill -9 "$(cat qemu.pid)"
  wait "$guest" 2>/dev/null || true
  "$here/power_cut.py" writes before.ext4 "$disk_kind" "$1"
  mv before.ext4 "$disk"
}

step "One whole part"
boot
ask
was=$sequence
begun=$(now_ms)
scan
is_sent() { ask && [ "$sequence" != "$was" ]; }
await 120 "the first correction" is_sent
whole_ms=$(($(now_ms) - begun))
echo "scanned, measured and committed in $whole_ms ms"
kill -9 "$(cat qemu.pid)"
wait "$guest" 2>/dev/null || true

step "The power cut $resets times; the disk's cache is $disk_kind"
sent=0
i=0
while [ "$i" -lt "$resets" ]; do
  i=$((i + 1))
  cp --sparse=always "$disk" before.ext4
  ask
  began=$sequence
  begun_with=$accepted
  boot
  ask
  # A commit that was on its way when the power went is settled, not sent again.
  [ "$sequence $accepted" = "$began $begun_with" ] ||
    fail "the start itself sent: sequence $began became $sequence, $begun_with commits $accepted"
  was=$sequence
  taken=$accepted
  scan
  delay=$(awk -v seed="$i" -v ms="$whole_ms" 'BEGIN { srand(seed); rand(); printf "%.2f", 1.2 * ms / 1000 * rand() }')
  sleep "$delay"
  cut=$(power_off "$i")
  sleep 1
  ask
  [ "$rows" = 2 ] || fail "the bender holds $rows rows"
  case $((accepted - taken)) in
  0) [ "$sequence" = "$was" ] || fail "sequence $was became $sequence, and no commit was taken" ;;
  1)
    [ "$sequence" -gt "$was" ] || fail "a commit was taken, and sequence $was became $sequence"
    sent=$((sent + 1))
    ;;
  *) fail "$((accepted - taken)) commits in one part" ;;
  esac
  echo "reset $i, $delay s after the first profile: sequence $was -> $sequence; $cut"
done

step "The last start: a whole part, then what the disk holds"
parts=1
# What the ledger lost of the tubes before makes the next one uncertain: it is held (BL3007).
[ "$disk_kind" = honest ] || parts=2
echo "$parts" >last
boot last
ask
was=$sequence
while [ "$parts" -gt 0 ]; do
  parts=$((parts - 1))
  scan
  await 180 "result of part $part" said "guest: $parts parts to come" console
done
code=0
wait "$guest" || code=$?
[ "$code" = 0 ] || fail "the guest's last part: $code"
ask
[ "$sequence" -gt "$was" ] || fail "the last part was not corrected"
tail -n 3 console
debugfs -R "rdump /var/lib/bendloop $work" "$disk" >debugfs.log 2>&1
state=$work/bendloop
for database in "$state"/*.db "$state"/sessions/*.session; do
  [ "$(sqlite3 "$database" 'PRAGMA integrity_check')" = ok ] || fail "$database is not sound"
done
open=$(sqlite3 "$state/journal.db" "SELECT count(*) FROM attempt WHERE (SELECT step FROM step
  WHERE step.attempt = attempt.id ORDER BY step.id DESC LIMIT 1) IN ('begun', 'committing')")
[ "$open" = 0 ] || fail "$open attempts are open in the journal"
committed=$(sqlite3 "$state/journal.db" "SELECT count(*) FROM step WHERE step = 'committed'")
# On a disk that lies the journal may not know of what it was about to write.
[ "$committed" = "$accepted" ] || [ "$disk_kind" = lying ] ||
  fail "the bender took $accepted commits, the journal knows of $committed"
parts=$(find "$state/results" -name '*.json' | wc -l)
sessions=$(find "$state/sessions" -name '*.session' | wc -l)
echo "$resets resets, $disk_kind: service up $((resets + 1)) times, $sent programs sent in them, none twice;" \
  "the bender took $accepted, the journal has $committed and none open; $sessions sessions of $part scans," \
  "$parts results; all databases sound"
