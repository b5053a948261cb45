# shellcheck shell=sh source=/dev/null
# In a guest whose power is cut again and again (appliance_resets.sh): the service, whose scanner and bender
# are the host's. last: this is the last start, for so many parts.
set -e
. ./guest_service.sh
# This service's own start, at boot.
await_ready
bendloop status | grep '^alarm' | sed 's/^/guest: /' || true
! bendloop status | grep -E '^alarm BL501[01] ' || echo "guest: damaged database"
for session in /var/lib/bendloop/sessions/*.session; do
  [ -e "$session" ] || continue
  [ ! -e "checked-$(basename "$session")" ] || continue
  bendloop check "$session" >check.log 2>&1 || true
  sed -n "s/^.*\(part-[0-9]*.session: .*\)/guest: \1/p" check.log
  touch "checked-$(basename "$session")"
done
# What a disk that lies has lost of the journal looks like the PLC's doing: somebody has to look.
if bendloop status | grep -q '^alarm BL4002 '; then
  bendloop acknowledge --config /etc/bendloop/cell.toml >/dev/null || fail "it cannot be acknowledged"
  echo "guest: acknowledged"
fi
note_told
echo "guest: ready with $(results) results"
[ -e last ] || exec sleep 3600

parts=$(cat last)
while [ "$parts" -gt 0 ]; do
  parts=$((parts - 1))
  await_told
  note_told
  echo "guest: $parts parts to come"
done
newest_is_committed
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well"
sync
