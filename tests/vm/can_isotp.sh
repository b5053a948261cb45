# shellcheck shell=sh
# In the guest: the bender link over ISO-TP on a virtual CAN bus, and the simulated bender as a process
# of its own, asked by can-utils.
set -e
ip link add dev vcan0 type vcan
ip link set vcan0 up
ip link add dev vcan1 type vcan

echo '{"rows": [{"length_mm": 100, "rotation_deg": 0, "angle_deg": 90, "bend_radius_mm": 30},
  {"length_mm": 80, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}' >/tmp/program.json
mkfifo /tmp/operator
bendloop-simbender --map /map.toml --program /tmp/program.json --pipe-radius 8 --part-number 77 \
  --can vcan0 </tmp/operator >/tmp/simbender &
exec 3>/tmp/operator
until grep -q 'listening vcan0' /tmp/simbender; do usleep 50000; done
isotprecv -s 7E0 -d 7E8 vcan0 >/tmp/answer &
until [ -s /tmp/answer ]; do # isotprecv may not listen yet
  # Modbus TCP, transaction 5, unit 1: read 2 holding registers from 100, the active part number.
  echo '00 05 00 00 00 06 01 03 00 64 00 02' | isotpsend -s 7E0 -d 7E8 -p CC:CC vcan0
  usleep 200000
done
echo "answer: $(cat /tmp/answer)"
grep -q '00 05 00 00 00 07 01 03 04 00 00 00 4D' /tmp/answer
echo quit >&3

candump -n 1 vcan0,18DA10F1:1FFFFFFF >/tmp/seen &
can_isotp_test
cat /tmp/seen
grep -q '18DA10F1   \[8\]  10 0C' /tmp/seen
