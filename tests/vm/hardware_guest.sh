# shellcheck shell=sh source=/dev/null
# In a guest with a bare Debian and its systemd: the installed service, under its unit, with a USB scanner (an
# emulated device port), a bender on a CAN bus (vcan) and one on a serial port (the host's, asked to bend on the
# console).
set -e
. ./guest_service.sh
busybox() { ./busybox "$@"; }
chmod +x busybox
busybox ip link add dev vcan0 type vcan
busybox ip link set vcan0 up
mountpoint -q /sys/kernel/config || mount -t configfs none /sys/kernel/config

step "Installed"
apt-get -q -y install ./bendloop*.deb >install.log 2>&1 || fail "$(cat install.log)"
cp one_bend.toml /etc/bendloop/parts/

# cell BENDER: the scanner on USB and this bender, by the unit that the cell's drop-in makes
cell() {
  cat >/etc/bendloop/cell.toml <<CELL
schema = "bendloop.cell/1"
name = "Hardware"
part = "parts/one_bend.toml"
[scanner]
kind = "usb"
serial = "CELL3"
[bender]
$1
connect_timeout_ms = 3000
response_timeout_ms = 3000
commit_timeout_ms = 10000
CELL
  granted
  sed -n '/^[A-Z]/p' /etc/systemd/system/bendloopd.service.d/50-cell.conf
  systemctl restart bendloopd || fail "the service does not start"
  systemd-analyze security bendloopd | tail -n 1
  await_ready
}
plug_seen() { [ -e /dev/bendloop/scanner-CELL3 ]; }
scan() { # $1: as the gadget calls it, of a tube that the bender has just bent
  await_seen 1
  note_told
  echo "scan $1" >&4
  await_told
}

step "A scanner on USB, a bender on CANopen"
mkfifo bender.in scanner.in
mkdir tray
bendloop-simbender --map /etc/bendloop/register-maps/canopen.toml --program first-program.json --pipe-radius 4 \
  --part-number 7 --canopen vcan0 --node 5 --object-dictionary /etc/bendloop/object-dictionaries/default.eds \
  --tray tray <bender.in >bender.out 2>&1 &
exec 3>bender.in
bendloop-usbscanner --serial CELL3 --pace max <scanner.in >scanner.out 2>&1 &
exec 4>scanner.in
await 60 "bender" said listening bender.out
await 60 "scanner" said listening scanner.out
await 60 "link to the scanner, by the udev rule" plug_seen
cell 'link = "canopen"
can_interface = "vcan0"
can_node_id = 5
object_dictionary = "object-dictionaries/default.eds"
register_map = "register-maps/canopen.toml"'
echo bend >&3
await 60 "a bent part" test -e tray/part-0001.json
scan part-0001.session
newest_is_committed
echo "measured from USB, corrected over CANopen"

step "The cable pulled, and plugged in again"
echo unplug >&4
await 60 "alarm of the missing scanner" alarmed BL1001
echo plug >&4
await 60 "end of the alarm" alarm_ended BL1001
await_ready
echo "told, and gone by itself"

step "The same scanner, a bender on a serial port"
systemctl stop bendloopd
# Another bender counts its own tubes: another cell, with a state of its own.
rm -r /var/lib/bendloop/*
cell 'link = "modbus-rtu"
device = "/dev/ttyS1"
register_map = "register-maps/default.toml"'
echo "host: bend"
scan part-0001.session
newest_is_committed
echo "measured from USB, corrected over a serial line"
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well"
step "done"
