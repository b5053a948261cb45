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
kind=${4:-honest}
here=$(dirname -- "$(realpath "$0")")
mkdir -p "$cache"
cache=$(realpath "$cache")
export TMPDIR="$cache" # a disk of some hundred MB, which a /tmp in memory may not take
rate=200
log=console
# shellcheck source=tests/vm/machines.sh disable=SC2034,SC2154
. "$here/machines.sh"
# shellcheck source=tests/vm/installed_root.sh
. "$here/installed_root.sh"
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  code=$?
  set +e
  tell_end "$code"
  [ ! -s "$work/qemu.pid" ] || kill -9 "$(cat "$work/qemu.pid")" 2>/dev/null
  machines_off
  root_off
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
need debugfs e2fsck

image=$("$here/appliance_image.sh" "$build" "$cache" "$work")
disk=$work/disk.ext4

step "A bender and a scanner that nobody resets"
bender_on
scanner_on 0

step "Installed on the guest's disk, with a cell that has these"
root_with "${image%.ext4}.tar" "$work"/packages/bendloop_*.deb || fail "it cannot be installed"
cp "$here/one_bend.toml" "$root/etc/bendloop/parts"
scanner_port=$(port_of scanner)
# In a shell of its own: what guests and this machine call alike is not the same.
# shellcheck source=/dev/null
(. "$here/guest_service.sh" && cell_of "Power cuts" "$scanner_port" "$bender_port" 10.0.2.2) >"$root/etc/bendloop/cell.toml"
inside bendloop check /etc/bendloop/cell.toml || fail "the cell is wrong"
mkdir -p "$root/etc/systemd/system/bendloopd.service.d"
inside bendloop check --unit-drop-in /etc/bendloop/cell.toml >"$root/etc/systemd/system/bendloopd.service.d/50-cell.conf"
inside systemctl enable bendloopd >install.log 2>&1 || fail "$(cat install.log)"
root_to "$disk"

boot() { # boot FILE...: the guest runs, with these taken along
  : >console
  rm -f qemu.pid
  GUEST_DISK=$disk GUEST_DISK_STAYS=1 GUEST_WRITES=$work/writes GUEST_NET=1 GUEST_PID=$work/qemu.pid \
    GUEST_MEMORY_MB=768 GUEST_CPUS=1 GUEST_SECONDS=900 \
    "$here/run_guest.sh" "$cache" "" "$here/reset_guest.sh" "$here/guest_service.sh" "$@" >console 2>&1 &
  guest=$!
  await 600 "the service in the guest" is_up_or_over
  if ! is_up; then
    code=0
    is_failed || wait "$guest" || code=$?
    [ "$code" != 77 ] || skip "no guest can be had: $(tail -n 1 console)"
    fail "the service in the guest is not ready"
  fi
  ! said 'guest: damaged' console || [ "$kind" = lying ] || fail "a database is damaged"
  grep '^guest: ' console | tr -d '\r'
}
is_up() { said 'guest: ready' console; }
is_failed() { said 'guest: failed' console; }
is_up_or_over() { is_up || is_failed || ! kill -0 "$guest" 2>/dev/null; }
# The cell's heartbeat, which it writes after a look at the bender.
beat() {
  : >bender.out
  echo told >&3
  await 120 "the bender's answer" said '^told .*heartbeat [0-9]' bender.out
  beat=$(sed -n 's/^told .*heartbeat \([0-9]*\).*/\1/p' bender.out)
}
beats_on() { beat && [ "$beat" != "$beat_before" ]; }
bend_and_scan() {
  bend
  # The look before the first beat may have been under way when the tube was counted, that before the second was not.
  beat
  for look in first second; do
    beat_before=$beat
    await 300 "the $look look at the bender after part $part" beats_on
  done
  scan
}
# state_on_disk: a copy of it, in bendloop/, as the next start finds it
state_on_disk() {
  cp --sparse=always "$disk" look.ext4
  e2fsck -fy -E journal_only look.ext4 >debugfs.log 2>&1 || true
  rm -rf bendloop
  debugfs -R "rdump /var/lib/bendloop $work" look.ext4 >>debugfs.log 2>&1
  rm look.ext4
}
power_off() { # power_off SEED: kills the guest; its disk then holds what such a disk does
  cut_ms=$(now_ms)
  kill -9 "$(cat qemu.pid)"
  wait "$guest" 2>/dev/null || true
  cut=$("$here/power_cut.py" writes before.ext4 "$kind" "$1")
  mv before.ext4 "$disk"
  state_on_disk
  judge_session bendloop/sessions
}

step "One whole part"
cp --sparse=always "$disk" before.ext4
boot
ask
was=$sequence
begun=$(now_ms)
bend_and_scan
is_sent() { ask && [ "$sequence" != "$was" ]; }
await 600 "the first correction" is_sent
whole_ms=$(($(now_ms) - begun))
echo "scanned, measured and committed in $whole_ms ms"
power_off 0

step "The power cut $resets times; the disk's cache is $kind"
settled=0
locked=0
i=0
while [ "$i" -lt "$resets" ]; do
  i=$((i + 1))
  now_step="power cut $i of $resets; the disk's cache is $kind"
  cp --sparse=always "$disk" before.ext4
  await 120 "a bender that has done all that was sent to it" has_done_all
  ask
  began="$sequence $accepted"
  boot
  ask
  judge_start
  ! said 'guest: alarm BL5009' console || settled=$((settled + 1))
  ! said 'guest: acknowledged' console || locked=$((locked + 1))
  was=$sequence
  taken=$accepted
  bend_and_scan
  delay=$(awk -v chance="$(chance "$kind $i")" -v ms="$whole_ms" 'BEGIN { printf "%.2f", 1.2 * ms / 1000 * chance }')
  sleep "$delay"
  power_off "$i"
  await 120 "a bender that has done all that was sent to it" has_done_all
  ask
  judge_program
  echo "reset $i, $delay s after the first profile: sequence $was -> $sequence, $lost_ms ms of its session lost; $cut"
done

step "The last start: a whole part, then what the disk holds"
parts=1
# What the ledger lost of the tubes before makes the next one uncertain: it is held (BL3007).
[ "$kind" = honest ] || parts=2
is_told_or_over() { said "guest: $parts parts to come" console || ! kill -0 "$guest" 2>/dev/null; }
echo "$parts" >last
boot last
ask
was=$sequence
while [ "$parts" -gt 0 ]; do
  parts=$((parts - 1))
  bend_and_scan
  await 600 "what became of part $part" is_told_or_over
  said "guest: $parts parts to come" console || fail "the guest ended before part $part was done"
done
code=0
wait "$guest" || code=$?
[ "$code" = 0 ] || fail "the guest ended with $code"
ask
[ "$sequence" -gt "$was" ] || fail "the last part was not corrected"
tail -n 3 console
state_on_disk
judge_state bendloop
echo "$resets resets, $kind: service up $((resets + 2)) times by itself, $settled settled a commit that was on its way;" \
  "$sent programs sent before a cut, none twice; the bender took $accepted, the journal has $committed and none open;" \
  "$locked times corrections were locked, and somebody had to look; $results results and $sessions sessions of $part" \
  "scans, of which a cut took $most_lost_ms ms at most; all databases sound"
