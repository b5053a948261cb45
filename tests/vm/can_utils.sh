# shellcheck shell=sh
# In the guest: the kernel has CAN, and can-utils see what can-utils send.
set -e
ip link add dev vcan0 type vcan
ip link set vcan0 up
candump -n 1 vcan0 >/tmp/seen &
until [ -s /tmp/seen ]; do # candump may not listen yet
  cansend vcan0 5A1#11.22.33
  usleep 100000
done
wait
cat /tmp/seen
grep -q '5A1   \[3\]  11 22 33' /tmp/seen
