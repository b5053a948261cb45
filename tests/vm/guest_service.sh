# shellcheck shell=sh
# In a guest: what the scripts that try the service share. Read by them, in /root. Functions, and a trap that tells of what
# fails.
# A failure's last lines are what one sees of it: they say in which step it was, and what was awaited.
now_step='its begin'
failure=''
up_s() { cut -d . -f 1 /proc/uptime; } # since the boot: the clock may be stepped
step() {
  now_step=$*
  echo "== [$(cut -d ' ' -f 1 /proc/uptime) s] $*"
}
fail() {
  failure=$*
  echo "guest: $*" >&2 # what `$(...)` runs has a shell of its own, which tells nobody at its end
  exit 1
}
tell_end() { # tell_end CODE: of the script
  [ "$1" != 0 ] || return 0
  [ -n "$failure" ] || failure="a command of it ended with $1; what it said stands above"
  echo "-- the service's last lines:"
  journalctl -b -u bendloopd --no-pager -o cat -n 15 2>/dev/null | cut -c 1-300
  echo "-- what the daemon says:"
  bendloop status 2>&1 | grep -E '^(alarm|state|problem|bender|scan session|last part|.*no daemon)' | cut -c 1-200
  echo "guest: failed after $(up_s) s, in step: $now_step"
  echo "guest: failed: $failure"
}
trap 'tell_end $? || true' EXIT
# page NAME: of the daemon's status server; bash alone, as `bendloop status` takes a guest in software half a second
page() {
  bash -c "exec 3<>/dev/tcp/127.0.0.1/7480 && printf 'GET /$1 HTTP/1.0\r\nHost: localhost\r\n\r\n' >&3 && cat <&3" 2>/dev/null
}
# state: what the daemon says that it does, or nothing
state() { page status | sed -n '/^  "state": /{s/.*: "\(.*\)".*/\1/p;q}'; }
await() { # await SECONDS WHAT COMMAND...: until it succeeds
  await_end=$(($(up_s) + $1))
  awaited="$2 (awaited for $1 s)"
  shift 2
  until "$@"; do
    [ "$(up_s)" -lt "$await_end" ] || fail "not seen: $awaited; state: $(state)"
    sleep 0.3
  done
}
is_ready() { [ "$(state)" = "waiting for a scan" ]; }
# Long: a guest in software, on a machine that has other work.
await_ready() { await 300 "a daemon that waits for a scan" is_ready; }
# alarmed CODE: it is active
alarmed() { page metrics | grep -q "^bendloop_alarm_active{code=\"$1\".* 1\$"; }
alarm_ended() { page metrics | grep -q "^bendloop_alarm_active{code=\"$1\".* 0\$"; }
results() { find /var/lib/bendloop/results -name '*.json' 2>/dev/null | wc -l; }
# A scan is over when the daemon says of it what became of it; its result may be written later, where a full disk did not
# take it, and so may that of one before.
last_told() { sed -n '/^  "last_part": /,/^  }/s/^    "session": "\(.*\)".*/\1/p' status.now; }
look() { page status >status.now && grep -q '^  "state": ' status.now; }
note_told() { # before a scan: which one it told of last
  await 300 "what the daemon says" look
  told=$(last_told)
}
is_told() { # it tells of another one, and waits for the next
  look && grep -q '^  "state": "waiting for a scan"' status.now && now_told=$(last_told) &&
    [ -n "$now_told" ] && [ "$now_told" != "$told" ]
}
await_told() { await 600 "what became of the scan" is_told; }
outcome_of_newest() { # what became of its correction; by the results' numbers: the clock is set back and forth
  newest=$(find /var/lib/bendloop/results -name '*.json' | sort -V | tail -n 1)
  sed -n '/"bender"/,$s/.*"outcome": *"\([a-z]*\)".*/\1/p' "$newest" | head -n 1
}
# A correction waits for a bender that did not answer in time, and is tried again.
is_decided() { case $(outcome_of_newest) in waiting | unknown) return 1 ;; esac }
newest_is_committed() {
  await 300 "the end of a correction that waits" is_decided
  [ "$(outcome_of_newest)" = committed ] || fail "not committed: $(outcome_of_newest), $(grep '"reason"' "$newest")"
}
said() { grep -q "$1" "$2"; } # said WORDS FILE
# granted: the drop-in of the cell, so that the unit lets it have its devices and addresses
granted() {
  bendloop check /etc/bendloop/cell.toml || fail "the cell is wrong"
  mkdir -p /etc/systemd/system/bendloopd.service.d
  bendloop check --unit-drop-in /etc/bendloop/cell.toml >/etc/systemd/system/bendloopd.service.d/50-cell.conf
  systemctl daemon-reload
}

# cell_of NAME SCANNER_PORT BENDER_PORT [HOST]: a cell file for scripts with these machines (default: on loopback)
cell_of() {
  host=${4:-127.0.0.1}
  cat <<CELL
schema = "bendloop.cell/1"
name = "$1"
part = "parts/one_bend.toml"
[scanner]
kind = "stream"
host = "$host"
port = $2
[bender]
link = "modbus-tcp"
host = "$host"
port = $3
register_map = "register-maps/default.toml"
# A guest in software is slow: its times are longer than a cell's.
connect_timeout_ms = 3000
response_timeout_ms = 3000
commit_timeout_ms = 10000
[correction]
# Each part brings a commit, however small.
deadband_sigmas = 0
CELL
}
# machines_on PROGRAM RATE: a bender with this program and a scanner of so many profiles a second, on loopback, for
# `cell_of NAME 7420 1502`; asked by bend, scan and sequence
machines_on() {
  part=0
  mkfifo bender.in scanner.in
  mkdir tray
  bendloop-simbender --port 1502 --map /etc/bendloop/register-maps/default.toml --tray tray --program "$1" \
    --part-number 7 --pipe-radius 4 --springback-20 1.2 --springback-120 3.6 --elongation 1.5 --scatter-angle 0.3 \
    <bender.in >>bender.out 2>&1 &
  exec 3>bender.in
  bendloop-simscanner --port 7420 --spacing 1 --rays 160 --views 2 --rate "$2" <scanner.in >>scanner.out 2>&1 &
  exec 4>scanner.in
  await 300 "bender" said listening bender.out
  await 300 "scanner" said listening scanner.out
}
bend() { # the next part lies on the tray
  part=$((part + 1))
  tube=$(printf 'tray/part-%04d.json' "$part")
  echo bend >&3
  await 300 "part $part on the tray" test -e "$tube"
}
# await_seen COUNT: the daemon has seen that the bender counts so many tubes; version 0.1.0 does not say
is_seen() { look && { grep -q "\"parts_bent\": $1[^0-9]*\$" status.now || ! grep -q '"parts_bent"' status.now; }; }
await_seen() {
  await 300 "the count of $1, seen by the daemon" is_seen "$1"
  grep -q '"parts_bent"' status.now || sleep 1 # it looks twice a second
}
bend_seen() {
  bend
  await_seen "$part"
}
scan() { echo "scan $tube" >&4; } # the part that was bent last
sequence() { # of the bender's program
  : >bender.out
  echo status >&3
  await 300 "the bender's answer" said sequence bender.out
  sed -n 's/.*sequence[^0-9]*\([0-9]*\).*/\1/p' bender.out | head -n 1
}
# part_scanned: the next one is bent and scanned, and it is known what became of it
part_scanned() {
  await_ready
  note_told
  bend_seen
  scan
  await_told
}
whole_part() { # bent, scanned, measured and corrected
  part_scanned
  newest_is_committed
}
# scan_held: stands still in its middle until go_on
scan_held() {
  echo "misbehave stall 3600000 after 200" >&4
  scan
}
go_on() { echo "go on" >&4; }
