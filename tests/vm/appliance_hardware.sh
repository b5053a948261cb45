#!/bin/sh
# The packages in a Debian under qemu, whose service reaches its scanner over USB and its bender over CAN and a
# serial port: hardware_guest.sh says what is tried.
# usage: appliance_hardware.sh BUILD CACHE
# Needs root for the guest's disk. Exits with 77 where it cannot be tried.
set -eu
build=$(realpath "$1")
cache=$2
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)
children=
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  # shellcheck disable=SC2086  # process numbers
  kill $children 2>/dev/null || true
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
image=$("$here/appliance_image.sh" "$build" "$cache" "$work")

# A tube that was bent and scanned here; the guest's scanner plays it.
"$build/bin/bendloop" demo --quick --parts 1 --spacing 1 --rays 160 --part "$here/one_bend.toml" --no-color \
  --out "$work/demo" >"$work/demo.log" 2>&1 || {
  cat "$work/demo.log" >&2
  exit 1
}
mkfifo "$work/bender.in"
"$build/bin/bendloop-simbender" --rtu --map "$here/../../config/register-maps/default.toml" \
  --program "$work/demo/first-program.json" --part-number 7 --pipe-radius 4 <"$work/bender.in" >"$work/bender.out" 2>&1 &
children=$!
exec 3>"$work/bender.in"
tries=100
until grep -q '^listening' "$work/bender.out"; do
  tries=$((tries - 1))
  [ "$tries" -gt 0 ] || { cat "$work/bender.out" >&2; exit 1; }
  sleep 0.1
done
: >"$work/console"
{ # bends when the guest says so
  tail -n +1 -F "$work/console" 2>/dev/null | grep -q --line-buffered '^host: bend' && echo bend >&3
} &
children="$children $!"
export GUEST_DISK="$image" GUEST_MEMORY_MB=1024 GUEST_CPUS=1 GUEST_SECONDS="${GUEST_SECONDS:-1500}"
GUEST_SERIAL=$(sed -n 's/^listening //p' "$work/bender.out")
export GUEST_SERIAL
code=0
"$here/run_guest.sh" "$cache" "vcan can-raw dummy_hcd usb_f_fs" "$here/hardware_guest.sh" "$work"/packages/bendloop_*.deb \
  "$work"/packages/bendloop-demo_*.deb "$here/guest_service.sh" "$here/one_bend.toml" "$(command -v busybox)" \
  "$work/demo/first-program.json" "$work/demo/sessions/part-0001.session" >"$work/console" 2>&1 || code=$?
cat "$work/console"
exit "$code"
