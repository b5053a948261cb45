# shellcheck shell=sh source=/dev/null
# In a guest with a bare Debian and its systemd: the packages by apt, a corrected part, the service with a
# bender and a scanner on loopback, what is left of it when it is killed.
# kills.txt: how often it is killed.
set -e
. ./guest_service.sh
kills=$(cat kills.txt)

step "First command: apt install ./bendloop*.deb"
apt-get -q -y install ./bendloop*.deb >install.log 2>&1 || fail "$(cat install.log)"
grep 'no cell is configured yet' install.log
! systemctl --quiet is-active bendloopd || fail "installing started the service"
! systemctl --quiet is-enabled bendloopd || fail "installing enabled the service"

step "Second command: bendloop demo"
bendloop demo --quick --parts 1 --spacing 1 --rays 160 --part one_bend.toml --no-color >demo.log 2>&1 ||
  fail "$(cat demo.log demo-out/logs/*)"
grep -E 'committed as sequence|of the tolerance' demo.log

step "The service: a cell on loopback, rated as it runs"
cp one_bend.toml /etc/bendloop/parts/
{
  cell_of Guest 7420 1502
  printf '[realtime]\nmode = "required"\n'
} >/etc/bendloop/cell.toml
granted
machines_on demo-out/first-program.json 4000
systemctl enable --now bendloopd || fail "the service does not start"
systemctl --quiet is-active bendloopd || fail "the service is not up"
systemd-analyze security bendloopd | tail -n 1

seconds() { cut -d ' ' -f 1 /proc/uptime; }
step "A scan over TCP, a correction over Modbus"
await_ready
note_told
bend_seen
begun=$(seconds)
scan
await_told
whole=$(awk -v a="$begun" -v b="$(seconds)" 'BEGIN { printf "%.1f", b - a }')
newest_is_committed
echo "scanned, measured and committed in $whole s"

step "Reloaded between two parts, by systemctl"
pid=$(systemctl show -p MainPID --value bendloopd)
cp /etc/bendloop/cell.toml good.toml
sed 's/^kind = .*/kind = "crystal ball"/' good.toml >/etc/bendloop/cell.toml
systemctl reload bendloopd || fail "no reload: $(systemctl status bendloopd)"
await 300 "alarm of the refused file" alarmed BL5013
sed 's/^name = .*/name = "Guest, reloaded"/' good.toml >/etc/bendloop/cell.toml
systemctl reload bendloopd || fail "no second reload: $(systemctl status bendloopd)"
await 300 "end of the alarm" alarm_ended BL5013
await_ready
[ "$(systemctl show -p MainPID --value bendloopd)" = "$pid" ] || fail "a reload began another process"
[ "$(systemctl show -p ReloadResult --value bendloopd)" = success ] || fail "the reload failed"
whole_part
echo "a wrong file refused, a good one taken, by the same process; the next part committed"

step "A support bundle of the installed service"
bendloop support-bundle --out support.tar.gz >support.log 2>&1 || fail "$(cat support.log)"
tar -tzf support.tar.gz >support.list
for held in cell.toml journal.db history.db .session; do
  grep -q -F "$held" support.list || fail "no $held in the bundle: $(cat support.list)"
done
echo "$(wc -l <support.list) files, $(stat -c %s support.tar.gz) bytes"

pid=$(systemctl show -p MainPID --value bendloopd)
step "The disk filled in the middle of it all"
# All that is not root's own, so that the daemon has nothing.
fill() { fallocate -l "$(df --output=avail -B 1 /var/lib/bendloop | tail -n 1)" "/var/lib/fill-$1" 2>/dev/null || true; }
fill 1
fill 2
note_told
bend
sleep 1 # what the bender does cannot be kept, so the count that it sees is not said
scan
await 300 "alarm of the full disk" alarmed BL5006
await_told
bendloop status | grep '^alarm' || true
systemctl --quiet is-active bendloopd || fail "the full disk ended the service"
rm /var/lib/fill-*
# A correction that waited for the disk is sent now; a tube that was bent before it is measured and not corrected.
await 300 "end of BL5012" alarm_ended BL5012
part_scanned
whole_part
for code in BL5001 BL5002 BL5003 BL5006 BL5012; do await 300 "end of $code" alarm_ended "$code"; done
echo "told, and gone when there is room again; the next part committed"

step "The clock stepped a year ahead, and two years back"
for years in 1 -2 1; do
  date -s "@$(($(date +%s) + years * 31536000))"
  whole_part
done
systemctl --quiet is-active bendloopd || fail "a step of the clock ended the service"
[ "$(systemctl show -p MainPID --value bendloopd)" = "$pid" ] || fail "a full disk or the clock ended the process"
await 300 "end of BL5014" alarm_ended BL5014
echo "three parts committed, by the same process"

step "The machine swaps: a neighbour wants more memory than there is"
pid=$(systemctl show -p MainPID --value bendloopd)
dd if=/dev/zero of=/swap bs=1M count=500 status=none
chmod 600 /swap
mkswap /swap >/dev/null
swapon /swap
{ head -c 1000M /dev/zero 2>/dev/null; sleep 600; } | tail -c 1000M >/dev/null &
neighbour=$!
swapped_mb() { awk '/^SwapTotal/ { all = $2 } /^SwapFree/ { free = $2 } END { print int((all - free) / 1024) }' /proc/meminfo; }
swaps() { [ "$(swapped_mb)" -gt 100 ]; }
await 300 "a machine that swaps" swaps
await 300 "alarm of the swapping" alarmed BL5017
whole_part
daemon_kb() { sed -n "s/^$1:[^0-9]*\([0-9]*\) kB/\1/p" "/proc/$pid/status"; }
[ "$(daemon_kb VmSwap)" = 0 ] || fail "$(daemon_kb VmSwap) kB of the daemon are swapped out"
echo "$(swapped_mb) MB swapped out, none of the daemon, which has $(daemon_kb VmLck) kB locked; the part committed"
kill "$neighbour"
swapoff /swap
rm /swap
await 300 "end of BL5017" alarm_ended BL5017

step "Two neighbours that eat the processor"
sh -c 'while :; do :; done' &
neighbours=$!
sh -c 'while :; do :; done' &
neighbours="$neighbours $!"
whole_part
await 600 "alarm of the neighbours" alarmed BL5016
# shellcheck disable=SC2086  # process numbers
kill $neighbours
await 600 "end of BL5016" alarm_ended BL5016
[ "$(systemctl show -p MainPID --value bendloopd)" = "$pid" ] || fail "a neighbour ended the process"
echo "told, the part committed, by the same process; over by itself"

step "Killed $kills times, each at another time of a scan and its commit"
unfinished=0
sent=0
i=0
while [ "$i" -lt "$kills" ]; do
  i=$((i + 1))
  await_ready
  was=$(sequence)
  before=$(results)
  bend_seen
  scan
  # From the scan's first profile to after the commit.
  delay=$(awk -v seed="$i" -v whole="$whole" 'BEGIN { srand(seed); rand(); printf "%.2f", 1.1 * whole * rand() }')
  sleep "$delay"
  pid=$(systemctl show -p MainPID --value bendloopd)
  kill -9 "$pid"
  tries=0
  until now=$(systemctl show -p MainPID --value bendloopd) && [ "$now" != 0 ] && [ "$now" != "$pid" ] &&
    systemctl --quiet is-active bendloopd; do
    tries=$((tries + 1))
    [ "$tries" -lt 300 ] || fail "kill $i after $delay s: not up again"
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
whole_part
echo "$kills kills: service up $kills times, $sent programs sent once, $unfinished scans cut before their result," \
  "$(find /var/lib/bendloop/sessions -name '*.session' | wc -l) sessions, none damaged"

bendloop history --config /etc/bendloop/cell.toml --csv - >history.csv
[ "$(cut -d , -f 1 history.csv | sort | uniq -d | wc -l)" = 0 ] || fail "a part stands in the history twice: $(cat history.csv)"
[ "$(grep -c ',committed,' history.csv)" -ge "$sent" ] || fail "the history lacks a part that was sent: $(cat history.csv)"

step "Stopped and removed; the data stay"
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well: $(systemctl show -p Result bendloopd)"
apt-get -q -y remove bendloop bendloop-demo >remove.log 2>&1 || fail "$(cat remove.log)"
[ -s /var/lib/bendloop/history.db ] || fail "removing took the history"
step "done"
