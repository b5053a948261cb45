# shellcheck shell=sh
# In the guest: the software scanner on an emulated device port (dummy_hcd) and, on its host, the
# driver's tests, the whole demo, and the daemon when the cable is pulled.
set -e
step() { echo "== [$(cut -d ' ' -f 1 /proc/uptime) s] $*"; }
mount -t configfs none /sys/kernel/config
ip link set lo up
cd /tmp

step "The driver against the software scanner"
usb_guest_test --gtest_color=no --gtest_brief=1

step "The demo with its scanner on USB"
bendloop demo --scanner usb --part /one_bend.toml --parts 1 --quick --spacing 1 --rays 160 \
  --no-color --out demo >demo.out 2>&1 || { cat demo.out demo/logs/*; exit 1; }
grep -E 'scanner  laser|committed|of the tolerance' demo.out
grep -q 'committed as sequence 2' demo.out

step "The daemon: unplugged in the middle of a scan, plugged in again, then a whole scan"
mkfifo operator
bendloop-usbscanner --serial CELL3 --pace max <operator >gadget &
exec 3>operator
sed -e 's/^kind = .*/kind = "usb"\nserial = "CELL3"/' -e 's/^link = .*/link = "none"/' \
  -e 's/state_dir = "."/state_dir = "again"/' demo/cell.toml >demo/usb.toml
echo 'misbehave unplug 300 after 100' >&3
echo 'scan demo/scans/part-0001.session' >&3
bendloopd --config demo/usb.toml --parts 2 >daemon.out 2>&1 &
daemon=$!
until grep -q abandoned gadget; do usleep 50000; done
echo 'scan demo/scans/part-0001.session' >&3
wait $daemon || { cat daemon.out gadget; exit 1; }
grep -E 'scanner|went away|part One' daemon.out
grep -q 'scanner went away in the middle of the scan' demo/again/sessions/part-0001.session
grep -q 'no scanner: USB scanner 1209:0001 CELL3: was unplugged' daemon.out
echo quit >&3
step "done"
