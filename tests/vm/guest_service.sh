# shellcheck shell=sh
# In a guest: what the scripts that try the service share. Read by them, in /root. Functions alone.
step() { echo "== [$(cut -d ' ' -f 1 /proc/uptime) s] $*"; }
fail() {
  echo "guest: failed: $*"
  bendloop status 2>/dev/null || true
  journalctl -b -u bendloopd --no-pager -n 40 2>/dev/null || true
  exit 1
}
# page NAME: of the daemon's status server; bash alone, as `bendloop status` takes a guest in software half a second
page() {
  bash -c "exec 3<>/dev/tcp/127.0.0.1/7480 && printf 'GET /$1 HTTP/1.0\r\nHost: localhost\r\n\r\n' >&3 && cat <&3" 2>/dev/null
}
# state: what the daemon says that it does, or nothing
state() { page status | sed -n '/^  "state": /{s/.*: "\(.*\)".*/\1/p;q}'; }
await() { # await SECONDS WHAT COMMAND...: until it succeeds
  # By the time since the boot: the clock may be stepped.
  await_end=$(($(cut -d . -f 1 /proc/uptime) + $1))
  awaited=$2
  shift 2
  until "$@"; do
    [ "$(cut -d . -f 1 /proc/uptime)" -lt "$await_end" ] || fail "not seen: $awaited; state: $(state)"
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
has_more_results() { [ "$(results)" -gt "$1" ]; }
await_result() { await 600 "a result" has_more_results "$1"; } # until there are more than $1
newest_is_committed() {
  # By their numbers: the clock is set back and forth.
  newest=$(find /var/lib/bendloop/results -name '*.json' | sort -V | tail -n 1)
  grep -q '"outcome": *"committed"' "$newest" || fail "not committed: $(cat "$newest")"
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
    <bender.in >bender.out 2>&1 &
  exec 3>bender.in
  bendloop-simscanner --port 7420 --spacing 1 --rays 160 --views 2 --rate "$2" <scanner.in >scanner.out 2>&1 &
  exec 4>scanner.in
  await 300 "bender" said listening bender.out
  await 300 "scanner" said listening scanner.out
}
bend() { # the next part lies on the tray
  part=$((part + 1))
  tube=$(printf 'tray/part-%04d.json' "$part")
  echo bend >&3
  await 300 "part $part on the tray" test -e "$tube"
  sleep 1 # the daemon looks at the bender twice a second
}
scan() { echo "scan $tube" >&4; } # the part that was bent last
sequence() { # of the bender's program
  : >bender.out
  echo status >&3
  await 300 "the bender's answer" said sequence bender.out
  sed -n 's/.*sequence[^0-9]*\([0-9]*\).*/\1/p' bender.out | head -n 1
}
whole_part() { # bent, scanned, measured and corrected
  await_ready
  before=$(results)
  bend
  scan
  await_result "$before"
  newest_is_committed
}
