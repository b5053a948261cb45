#!/bin/sh
# How open the service is, by systemd's own count: at most 1.5, alone and with the drop-in of each kind
# of cell; and does systemd understand all of it?
# usage: unit.sh UNIT BENDLOOP CONFIG     the unit, the command line, the folder of the shipped configuration
# Exits with 77 where there is no systemd-analyze.
set -eu
unit=$1
bendloop=$2
config=$3
if ! command -v systemd-analyze >/dev/null; then
  echo "############ UNIT NOT RATED: systemd-analyze is missing; config/install-packages.sh test ############" >&2
  exit 77
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
failed=0

# rate NAME FILE: prints the rating and what it consists of where it is too high
rate() {
  if systemd-analyze security --offline=true --threshold=15 "$2" >"$work/rating" 2>&1; then
    echo "$1: $(tail -n 1 "$work/rating" | grep -oE '[0-9.]+ [A-Z]+')"
  else
    grep '^.\?✗\|Overall' "$work/rating" >&2
    echo "unit.sh: $1 is rated above 1.5" >&2
    failed=1
  fi
}

# Only the programs' places may be unknown here.
understood() {
  ! systemd-analyze verify "$1" 2>&1 | grep -v 'bendloopd is not executable' >&2 ||
    { echo "unit.sh: systemd does not understand $1" >&2; failed=1; }
}

rate "the unit" "$unit"
understood "$unit"
mkdir "$work/cells"
ln -s "$(realpath "$config/parts")" "$work/parts"
ln -s "$(realpath "$config/register-maps")" "$work/register-maps"
ln -s "$(realpath "$config/object-dictionaries")" "$work/object-dictionaries"
shop=$config/cells/press-shop.toml
can='s#^link = .*#link = "canopen"\ncan_interface = "can0"\nobject_dictionary = "../object-dictionaries/default.eds"#
  s#siemens-like#canopen#'
serial='s#^link = .*#link = "modbus-rtu"\ndevice = "/dev/ttyS0"#'
usb='s#^kind = .*#kind = "usb"#'
here='s#192[.0-9]*#127.0.0.1#'
for cell in "network" "network and CAN:$can" "network and serial:$serial" "USB and CAN:$usb;$can" \
  "USB and serial:$usb;$serial" "this machine:$here"; do
  name=${cell%%:*}
  changes=${cell#"$name"}
  sed -e "${changes#:}" "$shop" >"$work/cells/cell.toml"
  "$bendloop" check --unit-drop-in "$work/cells/cell.toml" >"$work/drop-in"
  # As systemd reads it: after the unit's own lines.
  cat "$unit" "$work/drop-in" >"$work/bendloopd.service"
  rate "a cell on $name" "$work/bendloopd.service"
  understood "$work/bendloopd.service"
  case $name in
    *network*) grep -q '^IPAddressAllow=192.168.10.20$' "$work/drop-in" || failed=1 ;;
    *) ! grep -q '^IPAddressAllow' "$work/drop-in" || failed=1 ;;
  esac
done
exit "$failed"
