# shellcheck shell=sh
# What the guides leave to hands and machines, for their tests: `<!-- hands: ... -->` in a guide calls these.
# The machines are the simulated ones; MACHINES is their folder.
MACHINES=$GUIDE_ROOT/run/machines

# until_true COMMAND...: at most 60 s
until_true() {
  tries=600
  until "$@"; do
    tries=$((tries - 1))
    [ "$tries" -gt 0 ] || { echo "hands.sh: waited in vain for: $*" >&2; exit 1; }
    sleep 0.1
  done
}

# cell_of_the_shop PART: what an integrator leaves behind: /etc/bendloop/cell.toml with this part file, and
# simulated machines at its addresses. The steel springs back more than part files say.
cell_of_the_shop() {
  cat >"$GUIDE_ROOT/etc/bendloop/cell.toml" <<END
schema = "bendloop.cell/1"
name = "Cell 3"
part = "$1"
state_dir = "$GUIDE_ROOT/var/lib/bendloop"

[scanner]
kind = "stream"
host = "127.0.0.1"
port = $GUIDE_SCANNER_PORT

[bender]
link = "modbus-tcp"
host = "127.0.0.1"
port = $GUIDE_BENDER_PORT
register_map = "register-maps/default.toml"
END
  mkdir -p "$GUIDE_ROOT/var/lib/bendloop"
}

# machines_on PART NUMBER PIPE-RADIUS: with any program of the part keyed in.
machines_on() {
  mkdir -p "$MACHINES"
  bendloop first-program --part "$1" --json >"$MACHINES/program.json"
  mkfifo "$MACHINES/to-bender"
  bendloop-simbender --port "$GUIDE_BENDER_PORT" --map "$GUIDE_ROOT/etc/bendloop/register-maps/default.toml" \
    --program "$MACHINES/program.json" --part-number "$2" --sequence 0 --pipe-radius "$3" \
    --springback-20 1.6 --springback-120 4 --elongation 2 --scatter-angle 0.03 --cycle-ms 100 \
    --tray "$MACHINES/tray" <"$MACHINES/to-bender" >"$MACHINES/bender.log" 2>&1 &
  exec 8>"$MACHINES/to-bender"
  scanner_on
}

scanner_on() {
  rm -f "$MACHINES/to-scanner"
  mkfifo "$MACHINES/to-scanner"
  bendloop-simscanner --port "$GUIDE_SCANNER_PORT" --spacing 0.5 --rate 2000 <"$MACHINES/to-scanner" \
    >"$MACHINES/scanner.log" 2>&1 &
  echo $! >"$MACHINES/scanner.pid"
  exec 9>"$MACHINES/to-scanner"
}

scanner_off() {
  kill "$(cat "$MACHINES/scanner.pid")"
}

# bend_and_scan N: the N-th tube, until what is measured stands in the history.
bend_and_scan() {
  tube=part-$(printf %04d "$1")
  echo bend >&8
  until_true grep -q "bent $tube" "$MACHINES/bender.log"
  bent_seen "$1" "$GUIDE_ROOT/etc/bendloop/cell.toml"
  echo "scan $MACHINES/tray/$tube.json" >&9
  until_true in_history "$tube"
}
# bent_seen N CELL: until the daemon has seen so many tubes counted, which takes it a look at the bender.
bent_seen() { until_true status_says "$2" "^bender parts bent *$1\$"; }
status_says() { bendloop status --config "$1" 2>/dev/null | grep -q "$2"; }
in_history() {
  bendloop history --config "$GUIDE_ROOT/etc/bendloop/cell.toml" --session "$1" --csv - 2>/dev/null | grep -q "$1"
}

# alarmed CODE, quiet CODE: until the daemon says so.
alarmed() { until_true alarm_is 1 "$1"; }
quiet() { until_true alarm_is 0 "$1"; }
alarm_is() {
  bendloop status --config "$GUIDE_ROOT/etc/bendloop/cell.toml" >"$GUIDE_ROOT/run/status"
  [ "$(grep -c "^alarm $2" "$GUIDE_ROOT/run/status")" = "$1" ]
}

# note_files: what the running daemon keeps, for files.sh.
note_files() { (cd "$GUIDE_ROOT" && find etc/bendloop var/lib/bendloop -type f -o -type s | sed 's#^#/#') >"$GUIDE_ROOT/run/files"; }
