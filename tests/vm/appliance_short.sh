#!/bin/sh
# One of each that the long proof does many times: the packages of a build in a Debian with systemd under qemu;
# short_guest.sh says what is tried. The power cut is appliance_resets.sh's.
# usage: appliance_short.sh BUILD CACHE
# Needs root for the guest's disk, whose Debian is made once and kept in CACHE. Exits with 77 where it cannot be tried.
set -eu
build=$(realpath "$1")
mkdir -p "$2"
cache=$(realpath "$2")
export TMPDIR="$cache" # a disk of some hundred MB, which a /tmp in memory may not take
here=$(dirname -- "$(realpath "$0")")
work=$(mktemp -d)
# shellcheck source=tests/vm/telling.sh
. "$here/telling.sh"
# shellcheck source=tests/vm/installed_root.sh
. "$here/installed_root.sh"
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  code=$?
  set +e
  tell_end "$code"
  root_off
  rm -rf --one-file-system "$work"
}
trap cleanup EXIT
image=$("$here/appliance_image.sh" "$build" "$cache" "$work")

step "apt install ./bendloop*.deb, in a bare Debian 12"
root_with "${image%.ext4}.tar" "$work"/packages/bendloop_*.deb "$work"/packages/bendloop-demo_*.deb
grep 'no cell is configured yet' "$work/install.log"
cp "$here/one_bend.toml" "$root/etc/bendloop/parts"

# cell NAME SCANNER BENDER: a cell file, and the drop-in by which the unit grants it what it needs; NAME.toml, NAME.conf
cell() {
  { # In a shell of its own: what guests and this machine call alike is not the same.
    # shellcheck source=/dev/null
    (. "$here/guest_service.sh" && cell_of Short 0 0) | sed -n '/^schema/,/^part/p'
    printf '[scanner]\n%s\n[bender]\n%s\n' "$2" "$3"
    # shellcheck source=/dev/null
    (. "$here/guest_service.sh" && cell_of Short 0 0) | sed -n '/^# A guest/,$p'
  } >"$root/etc/bendloop/cell.toml"
  inside bendloop check /etc/bendloop/cell.toml >"$work/check.log" 2>&1 || {
    cat "$work/check.log" >&2
    exit 1
  }
  inside bendloop check --unit-drop-in /etc/bendloop/cell.toml >"$root/root/$1.conf"
  mv "$root/etc/bendloop/cell.toml" "$root/root/$1.toml"
}
usb='kind = "usb"
serial = "CELL3"'
modbus='link = "modbus-tcp"
port = 1502
register_map = "register-maps/default.toml"'
cell can "$usb" 'link = "canopen"
can_interface = "vcan0"
can_node_id = 5
object_dictionary = "object-dictionaries/default.eds"
register_map = "register-maps/canopen.toml"'
cell modbus "$usb" "$modbus"
cell stream 'kind = "stream"
port = 7420' "$modbus"
# The first tube that the guest's bender will have bent (machines_on), scanned here; the USB scanner plays it.
inside bendloop first-program --part /etc/bendloop/parts/one_bend.toml --json >"$root/root/first-program.json"
inside bendloop simulate --part /etc/bendloop/parts/one_bend.toml --out /root/part-0001.session --springback-20 1.2 \
  --springback-120 3.6 --elongation 1.5 --scatter-angle 0.3 --spacing 1 --rays 160 --views 2
root_to "$work/disk.ext4"

step "The guest"
export GUEST_DISK="$work/disk.ext4" GUEST_MEMORY_MB=1024 GUEST_CPUS=1 GUEST_SECONDS="${GUEST_SECONDS:-600}"
"$here/run_guest.sh" "$cache" "vcan can-raw dummy_hcd usb_f_fs" "$here/short_guest.sh" "$here/guest_service.sh" \
  "$(command -v busybox)"
step "done"
