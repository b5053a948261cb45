# shellcheck shell=sh
# In the guest: the software scanner on an emulated device port (dummy_hcd), the driver on its host.
set -e
mount -t configfs none /sys/kernel/config
usb_guest_test --gtest_color=no --gtest_brief=1
