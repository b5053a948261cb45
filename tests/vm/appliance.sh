# shellcheck shell=sh
# In a guest with a bare Debian and its systemd: the packages by apt, a corrected part, the service with a
# bender and a scanner on loopback, what is left of it when it is killed.
# kills.txt: how often it is killed.
set -e
step() { echo "== [$(cut -d ' ' -f 1 /proc/uptime) s] $*"; }
fail() {
  echo "appliance: $*"
  journalctl -u bendloopd --no-pager -n 40 2>/dev/null || true
  exit 1
}
kills=$(cat kills.txt)

step "First command: apt install ./bendloop*.deb"
apt-get -q -y install ./bendloop*.deb >install.log 2>&1 || fail "$(cat install.log)"
grep 'no cell is configured yet' install.log
! systemctl --quiet is-active bendloopd || fail "installing started the service"
! systemctl --quiet is-enabled bendloopd || fail "installing enabled the service"

step "Second command: bendloop demo"
bendloop demo --quick --parts 2 --spacing 1 --rays 160 --part one_bend.toml --no-color >demo.log 2>&1 ||
  fail "$(cat demo.log demo-out/logs/*)"
grep -E 'committed as sequence|of the tolerance' demo.log

step "The service: a cell on loopback, rated as it runs"
cp one_bend.toml /etc/bendloop/parts/
cat >/etc/bendloop/cell.toml <<'CELL'
schema = "bendloop.cell/1"
name = "Guest"
part = "parts/one_bend.toml"
[scanner]
kind = "stream"
port = 7420
[bender]
link = "modbus-tcp"
port = 1502
register_map = "register-maps/default.toml"
# A guest in software is slow.
connect_timeout_ms = 3000
response_timeout_ms = 3000
commit_timeout_ms = 10000
[realtime]
mode = "required"
CELL
bendloop check /etc/bendloop/cell.toml
mkdir -p /etc/systemd/system/bendloopd.service.d
bendloop check --unit-drop-in /etc/bendloop/cell.toml >/etc/systemd/system/bendloopd.service.d/50-cell.conf
systemctl daemon-reload
mkfifo bender.in scanner.in
mkdir tray
bendloop-simbender --port 1502 --map /etc/bendloop/register-maps/default.toml --tray tray \
  --program demo-out/first-program.json --part-number 7 --pipe-radius 4 --springback-20 1.2 \
  --springback-120 3.6 --elongation 1.5 <bender.in >bender.out 2>&1 &
exec 3>bender.in
bendloop-simscanner --port 7420 --spacing 1 --rays 160 --views 2 --rate 4000 <scanner.in >scanner.out 2>&1 &
exec 4>scanner.in
until grep -q listening bender.out && grep -q listening scanner.out; do sleep 0.2; done
systemctl enable --now bendloopd || fail "the service does not start"
systemctl --quiet is-active bendloopd || fail "the service is not up"
systemd-analyze security bendloopd | tail -n 1

# state: what the daemon says that it does, or nothing
state() { bendloop status --json 2>/dev/null | tr ',' '\n' | sed -n 's/.*"state": *"\([^"]*\)".*/\1/p' | head -n 1; }
await_ready() {
  tries=0
  until [ "$(state)" = "waiting for a scan" ]; do
    tries=$((tries + 1))
    [ "$tries" -lt 300 ] || fail "not ready after 60 s, but: $(state)"
    sleep 0.2
  done
}
part=0
bend() { # the next part lies on the tray
  part=$((part + 1))
  tube=$(printf 'tray/part-%04d.json' "$part")
  echo bend >&3
  tries=0
  until [ -e "$tube" ]; do
    tries=$((tries + 1))
    [ "$tries" -lt 300 ] || fail "no part $part on the tray: $(tail -n 3 bender.out)"
    sleep 0.1
  done
  sleep 0.5 # the daemon looks at the bender twice a second
}
results() { find /var/lib/bendloop/results -name '*.json' 2>/dev/null | wc -l; }
await_result() { # until there are more than $1
  tries=0
  until [ "$(results)" -gt "$1" ]; do
    tries=$((tries + 1))
    [ "$tries" -lt 600 ] || fail "no result of part $part after 120 s: $(state)"
    sleep 0.2
  done
}
sequence() {
  : >bender.out
  echo status >&3
  until grep -q sequence bender.out; do sleep 0.1; done
  sed -n 's/.*sequence[^0-9]*\([0-9]*\).*/\1/p' bender.out | head -n 1
}

seconds() { cut -d ' ' -f 1 /proc/uptime; }
newest_is_committed() {
  newest=$(find /var/lib/bendloop/results -name '*.json' -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d ' ' -f 2)
  grep -q '"outcome": *"committed"' "$newest" || fail "not committed: $(cat "$newest")"
}

step "A scan over TCP, a correction over Modbus"
await_ready
before=$(results)
bend
begun=$(seconds)
echo "scan $tube" >&4
await_result "$before"
whole=$(awk -v a="$begun" -v b="$(seconds)" 'BEGIN { printf "%.1f", b - a }')
newest_is_committed
echo "scanned, measured and committed in $whole s"

step "Killed $kills times, each at another time of a scan and its commit"
unfinished=0
sent=0
i=0
while [ "$i" -lt "$kills" ]; do
  i=$((i + 1))
  await_ready
  was=$(sequence)
  before=$(results)
  bend
  echo "scan $tube" >&4
  # From the scan's first profile to after the commit.
  delay=$(awk -v seed="$i" -v whole="$whole" 'BEGIN { srand(seed); rand(); printf "%.2f", 1.1 * whole * rand() }')
  sleep "$delay"
  pid=$(systemctl show -p MainPID --value bendloopd)
  kill -9 "$pid"
  tries=0
  until now=$(systemctl show -p MainPID --value bendloopd) && [ "$now" != 0 ] && [ "$now" != "$pid" ] &&
    systemctl --quiet is-active bendloopd; do
    tries=$((tries + 1))
    [ "$tries" -lt 300 ] || fail "kill $i after $delay s: not up again after 60 s"
    sleep 0.2
  done
  await_ready
  is=$(sequence)
  # A number that was given out and not sent is never used again, so one may be left out.
  [ "$is" -ge "$was" ] || fail "kill $i after $delay s: sequence $was became $is"
  if [ "$(results)" = "$before" ]; then unfinished=$((unfinished + 1)); fi
  if [ "$is" != "$was" ]; then sent=$((sent + 1)); fi
  echo "kill $i after $delay s: sequence $was -> $is, results $before -> $(results)"
done

step "All that it left is sound, and the next part is measured and corrected"
for session in /var/lib/bendloop/sessions/*.session; do
  # One that was cut says that it is no whole scan; one that is damaged says that.
  bendloop check "$session" >check.log 2>&1 || cat check.log
  ! grep -i 'damaged\|checksum\|malformed' check.log || fail "$session is damaged"
done
before=$(results)
bend
echo "scan $tube" >&4
await_result "$before"
newest_is_committed
echo "$kills kills: service up $kills times, $sent programs sent once, $unfinished scans cut before their result," \
  "$(find /var/lib/bendloop/sessions -name '*.session' | wc -l) sessions, none damaged"

step "Stopped and removed; the data stay"
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well: $(systemctl show -p Result bendloopd)"
apt-get -q -y remove bendloop bendloop-demo >remove.log 2>&1 || fail "$(cat remove.log)"
[ -s /var/lib/bendloop/history.db ] || fail "removing took the history"
step "done"
