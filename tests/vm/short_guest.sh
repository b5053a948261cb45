# shellcheck shell=sh source=/dev/null
# In a guest with a Debian, its systemd and the packages: one of each that the long proof does many times
# (appliance_short.sh). The installed service with a scanner on USB and a bender on CANopen, and with one on Modbus over
# loopback; then a full disk, a stepped clock and kill -9 in the middle of a scan; the package again over it at work.
set -e
. ./guest_service.sh
busybox() { ./busybox "$@"; }
chmod +x busybox
main_pid() { systemctl show -p MainPID --value bendloopd; }
is_anew() { [ "$(main_pid)" != "$pid" ] && [ "$(main_pid)" != 0 ]; }
# settings NAME: this cell's, and its drop-in
settings() {
  cp "$1.toml" /etc/bendloop/cell.toml
  mkdir -p /etc/systemd/system/bendloopd.service.d
  cp "$1.conf" /etc/systemd/system/bendloopd.service.d/50-cell.conf
}
# cell NAME: the service with these, and no past
cell() {
  settings "$1"
  systemctl daemon-reload
  systemctl start bendloopd || fail "the service does not start"
  await_ready
}
scan_usb() { # the tube that was bent first
  await_seen 1
  note_told
  echo "scan part-0001.session" >&5
  await_told
  newest_is_committed
}

step "Machines; nothing was started by installing"
! systemctl --quiet is-active bendloopd || fail "installing started the service"
busybox ip link add dev vcan0 type vcan
busybox ip link set vcan0 up
mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config
mkfifo can.in usb.in
mkdir can-tray
bendloop-simbender --map /etc/bendloop/register-maps/canopen.toml --program first-program.json --pipe-radius 4 \
  --part-number 7 --canopen vcan0 --node 5 --object-dictionary /etc/bendloop/object-dictionaries/default.eds \
  --tray can-tray --springback-20 1.2 --springback-120 3.6 --elongation 1.5 --scatter-angle 0.3 <can.in >can.out 2>&1 &
exec 6>can.in
bendloop-usbscanner --serial CELL3 --pace max <usb.in >usb.out 2>&1 &
exec 5>usb.in
machines_on first-program.json 4000
await 120 "bender on CANopen" said listening can.out
await 120 "scanner on USB" said listening usb.out
await 120 "link to the scanner, by the udev rule" test -e /dev/bendloop/scanner-CELL3

step "A scanner on USB, a bender on CANopen"
cell can
echo bend >&6
await 120 "a bent part" test -e can-tray/part-0001.json
scan_usb
echo "measured from USB, corrected over CANopen"
systemctl stop bendloopd
rm -rf /var/lib/bendloop/* # another bender counts its own tubes

step "The same scanner, a bender on Modbus over loopback"
cell modbus
bend
scan_usb
echo "measured from USB, corrected over Modbus"

step "Reloaded with a scanner on loopback, too: a whole part"
pid=$(main_pid)
cp stream.toml /etc/bendloop/cell.toml
systemctl reload bendloopd || fail "no reload: $(systemctl status bendloopd)"
is_other_scanner() { page status | grep -q '"scanner": "bendloop simulated'; }
await 120 "the other scanner" is_other_scanner
whole_part
[ "$(main_pid)" = "$pid" ] || fail "a reload began another process"
echo "the part committed, by the same process"

step "The disk filled"
fill() { fallocate -l "$(df --output=avail -B 1 /var/lib/bendloop | tail -n 1)" "/var/lib/fill-$1" 2>/dev/null || true; }
fill 1
fill 2
note_told
bend
sleep 1 # what the bender does cannot be kept, so the count that it sees is not said
scan
await 120 "alarm of the full disk" alarmed BL5006
await 120 "alarm of what was not kept" alarmed BL5001
await_told
rm /var/lib/fill-*
await 120 "end of BL5012" alarm_ended BL5012
part_scanned # not corrected, perhaps: a tube was bent before that of which too little is known
for code in BL5001 BL5006; do await 120 "end of $code" alarm_ended "$code"; done
echo "told, and gone when there is room again"

step "The clock stepped a year ahead"
date -s "@$(($(date +%s) + 31536000))"
whole_part
[ "$(main_pid)" = "$pid" ] || fail "a full disk or the clock ended the process"
echo "the part committed, by the same process"

step "Killed in the middle of a scan"
was=$(sequence)
bend_seen
scan_held
is_scanning() { look && grep -q '^  "state": "scanning"' status.now; }
await 300 "a scan" is_scanning
kill -9 "$pid"
await 120 "another process" is_anew
await_ready
go_on
[ "$(sequence)" = "$was" ] || fail "sequence $was became $(sequence): the start itself sent"
whole_part
echo "up and ready by itself; nothing sent by its start; the next part committed"

step "The package again over it, at work"
pid=$(main_pid)
was=$(sequence)
kept=$(results)
dpkg -i ./bendloop_*.deb >again.log 2>&1 || fail "$(cat again.log)"
await 120 "another process" is_anew
await_ready
if [ "$(results)" != "$kept" ] || [ "$(sequence)" != "$was" ]; then fail "it changed results, or sent"; fi
whole_part
echo "restarted by itself; the next part committed"

step "All that it left is sound"
for session in /var/lib/bendloop/sessions/*.session; do
  bendloop check "$session" >check.log 2>&1 || true
  ! grep -i 'damaged\|checksum\|malformed' check.log || fail "$session is damaged"
done
bendloop history --config /etc/bendloop/cell.toml --csv - >history.csv
[ "$(cut -d , -f 1 history.csv | sort | uniq -d | wc -l)" = 0 ] || fail "a part stands in the history twice: $(cat history.csv)"
group=/sys/fs/cgroup/system.slice/bendloopd.service
[ "$(cat "$group/memory.max")" = $((1024 << 20)) ] || fail "the service may have $(cat "$group/memory.max") bytes of memory"
peak=$(cat "$group/memory.peak")
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well"
echo "$(find /var/lib/bendloop/sessions -name '*.session' | wc -l) sessions, none damaged; $(grep -c ',committed,' history.csv) commits;" \
  "the service had $((peak >> 20)) MB at most"
step "done"
