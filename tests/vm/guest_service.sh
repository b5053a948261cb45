# shellcheck shell=sh
# In a guest: what the scripts that try the service share. Read by them, in /root.
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
