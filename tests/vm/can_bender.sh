# shellcheck shell=sh
# In the guest: benders over ISO-TP and CANopen on a virtual CAN bus, asked by can-utils, by the links'
# tests, and by the whole demo with its daemon.
set -e
step() { echo "== [$(cut -d ' ' -f 1 /proc/uptime) s] $*"; }
ip link set lo up
ip link add dev vcan0 type vcan
ip link set vcan0 up
ip link add dev vcan1 type vcan
cd /tmp

step "ISO-TP: a simulated bender, asked by can-utils"
echo '{"rows": [{"length_mm": 100, "rotation_deg": 0, "angle_deg": 90, "bend_radius_mm": 30},
  {"length_mm": 80, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}' >program.json
mkfifo operator
bendloop-simbender --map /map.toml --program program.json --pipe-radius 8 --part-number 77 \
  --can vcan0 <operator >simbender &
exec 3>operator
until grep -q 'listening vcan0' simbender; do usleep 50000; done
candump -L vcan0,7E0:7FF,7E8:7FF >isotp.log &
dump=$!
until [ -s isotp.log ]; do # candump may not listen yet; nobody waits for this flow control frame
  cansend vcan0 7E8#300000
  usleep 50000
done
isotprecv -s 7E0 -d 7E8 vcan0 >answer &
until [ -s answer ]; do # isotprecv may not listen yet
  # Modbus TCP, transaction 5, unit 1: read 2 holding registers from 100, the active part number.
  echo '00 05 00 00 00 06 01 03 00 64 00 02' | isotpsend -s 7E0 -d 7E8 -p CC:CC vcan0
  usleep 200000
done
grep '00 05 00 00 00 07 01 03 04 00 00 00 4D' answer
kill $dump

step "ISO-TP: the commissioning robot"
cat >robot.toml <<'CELL'
schema = "bendloop.cell/1"
name = "CAN cell"
part = "/one_bend.toml"
state_dir = "robot"
[scanner]
kind = "simulated"
[bender]
link = "can-isotp"
can_interface = "vcan0"
can_request_id = 0x7e0
can_reply_id = 0x7e8
register_map = "/map.toml"
response_timeout_ms = 5000
commit_timeout_ms = 20000
CELL
cat >rig.sh <<'RIG'
case $1 in
cycle) fault="mode bending" ;;
guard) fault="mode not-ready" ;;
fault) fault="mode fault" ;;
idle) fault="mode idle" ;;
power-cycle) fault="reboot" ;;
edit) fault="edit 0.5" ;;
stop) fault="freeze" ;;
start) fault="behave" ;;
esac
said=$(wc -l </tmp/simbender)
echo "misbehave $fault" >&3
until [ "$(wc -l </tmp/simbender)" -gt "$said" ]; do usleep 20000; done
RIG
bendloop acceptance --config robot.toml --yes --operator 'sh /tmp/rig.sh' >robot.out 2>&1 ||
  { cat robot.out; exit 1; }
tail -n 4 robot.out
if grep -E 'FAIL|not tried' robot.out; then exit 1; fi
echo quit >&3

step "Both links' tests"
candump -n 1 vcan0,18DA10F1:1FFFFFFF >isotp_seen &
can_bender_test --gtest_brief=1 --gtest_filter='*isotp*' &
isotp=$!
can_bender_test --gtest_brief=1 --gtest_filter='*canopen*'
wait $isotp
can_bender_test --gtest_brief=1 --gtest_filter='CanBus.*'
grep '18DA10F1   \[8\]  10 0C' isotp_seen

step "The demo with its daemon over CANopen, among foreign traffic"
cangen vcan0 -g 1 -I 1A5 -L 8 &
foreign=$!
candump -L vcan0,585:7FF,605:7FF,705:7FF,085:7FF >canopen.log &
dump=$!
until [ -s canopen.log ]; do # candump may not listen yet; an emergency that says "no error" harms nobody
  cansend vcan0 085#0000000000000000
  usleep 50000
done
bendloop demo --link can --can-interface vcan0 --part /one_bend.toml --parts 2 --quick --spacing 1 \
  --rays 160 --no-color --out demo >demo.out 2>&1 || { cat demo.out demo/logs/*; exit 1; }
kill $foreign $dump
grep -E 'bender   CANopen|committed|PASS|of the tolerance' demo.out
grep -q 'committed as sequence 2' demo.out

step "The same session again, over CANopen: its tube is no new one, and nothing is sent"
sed 's/state_dir = "."/state_dir = "again"/' demo/live-cell.toml >demo/again.toml
mkfifo other
bendloop-simbender --map demo/canopen-map.toml --program demo/first-program.json --pipe-radius 4 \
  --part-number 7 --canopen vcan0 --node 5 --object-dictionary demo/bender.eds <other >simnode &
exec 4>other
until grep -q 'listening vcan0' simnode; do usleep 50000; done
cansend vcan0 605#4000200100000000 # the mode, as can-utils ask for it
if bendloop replay demo/sessions/part-0001.session --config demo/again.toml --send >again.out 2>&1; then
  cat again.out
  exit 1
fi
grep 'nothing was sent' again.out || { cat again.out; exit 1; }
echo status >&4
until grep 'sequence' simnode; do usleep 50000; done
grep -q 'accepted 0 ' simnode
echo quit >&4

step "Frames, for dissect_can.sh"
cat isotp.log
grep -v '705#05' canopen.log
step "done"
