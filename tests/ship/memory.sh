#!/bin/sh
# How much memory the daemon takes at most, with the scanner that asks for most (16384 points a profile) and parts one after
# the other: less than half of what its unit grants (MemoryMax)?
# usage: memory.sh BUILD [SPACING [RAYS [PARTS]]]
#   SPACING  mm between laser lines (default 1); RAYS a line (default 16384); PARTS one after the other (default 2)
set -eu
build=$(realpath "$1")
spacing=${2:-1}
rays=${3:-16384}
parts=${4:-2}
top=$(realpath "$(dirname -- "$0")/../..")
work=$(mktemp -d)
children=
# shellcheck disable=SC2317  # called by the trap
cleanup() {
  for child in $children; do kill -9 "$child" 2>/dev/null || true; done
  rm -rf "$work"
}
trap cleanup EXIT
cd "$work"
fail() {
  echo "memory.sh: $*" >&2
  tail -n 20 daemon.log >&2 || true
  exit 1
}
await() { # await SECONDS WHAT COMMAND...
  end=$(($(date +%s) + $1))
  what=$2
  shift 2
  until "$@"; do
    [ "$(date +%s)" -lt "$end" ] || fail "$what: not seen"
    sleep 0.1
  done
}
said() { grep -q "$1" "$2" 2>/dev/null; }
port_of() { sed -n 's/^listening //p' "$1"; }

granted_mb=$(sed -n 's/^MemoryMax=\([0-9]*\)M$/\1/p' "$top/systemd/bendloopd.service")
[ -n "$granted_mb" ] || fail "the unit has no MemoryMax=, in M"
"$build/bin/bendloop" first-program --part "$top/config/parts/demo.toml" --json >program.json
mkfifo bender.in scanner.in
mkdir tray
"$build/bin/bendloop-simbender" --map "$top/config/register-maps/default.toml" --tray tray --program program.json \
  --part-number 1001 --pipe-radius 4 <bender.in >bender.out 2>&1 &
children=$!
exec 3>bender.in
"$build/bin/bendloop-simscanner" --port 0 --spacing "$spacing" --rays "$rays" --views 2 --rate 300 <scanner.in \
  >scanner.out 2>&1 &
children="$children $!"
exec 4>scanner.in
await 20 "bender" said listening bender.out
await 20 "scanner" said listening scanner.out
cat >cell.toml <<CELL
schema = "bendloop.cell/1"
name = "Memory"
part = "$top/config/parts/demo.toml"
state_dir = "$work/state"
[scanner]
kind = "stream"
port = $(port_of scanner.out)
[scan]
max_seconds = 600
[bender]
link = "modbus-tcp"
port = $(port_of bender.out)
register_map = "$top/config/register-maps/default.toml"
CELL
"$build/bin/bendloopd" --config cell.toml --status-port 0 >daemon.log 2>&1 &
daemon=$!
children="$children $daemon"
status() { "$build/bin/bendloop" status --config cell.toml 2>/dev/null; }
is_ready() { status | grep -q '^state  *waiting for a scan$'; }
part=0
part_seen() { status | grep -q "^bender parts bent  *$part\$"; }
await 60 "a daemon that waits for a scan" is_ready
while [ "$part" -lt "$parts" ]; do
  part=$((part + 1))
  name=part-$(printf %04d "$part")
  echo bend >&3
  await 60 "tube $part" part_seen
  echo "scan tray/$name.json" >&4
  await 600 "result of part $part" test -e "state/results/$name.json"
done
await 60 "the daemon ready again" is_ready
grep -q '"verdict"' "state/results/$name.json" || fail "the last part was not measured"
peak_kb=$(sed -n 's/^VmHWM:[^0-9]*\([0-9]*\) kB$/\1/p' "/proc/$daemon/status")
"$build/bin/bendloop" check "state/sessions/$name.session" || true
echo "$parts parts of $(sed -n 's/^scanning .* \([0-9]*\) profiles$/\1/p' scanner.out | tail -n 1) profiles, up to $rays points each:" \
  "$((peak_kb >> 10)) MB at most, of $granted_mb MB that the unit grants"
[ "$((2 * (peak_kb >> 10)))" -le "$granted_mb" ] || fail "more than half of it"
