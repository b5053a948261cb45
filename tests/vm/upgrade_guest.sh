# shellcheck shell=sh source=/dev/null
# In a guest with a bare Debian and its systemd: version 0.1.0 installed, at work, and upgraded by apt to today's package
# (appliance_upgrade.sh). Data, settings and databases are kept, the service is up, and everything counts on.
set -e
. ./guest_service.sh
number() { # number FILE: its user_version, which stands in the head of a SQLite file
  od -An -t u1 -j 60 -N 4 "/var/lib/bendloop/$1" | awk '{ print $4 + 256 * ($3 + 256 * ($2 + 256 * $1)) }'
}

step "Version 0.1.0, at work"
apt-get -q -y install ./bendloop_0.1.0_*.deb >install.log 2>&1 || fail "$(cat install.log)"
cp -r /usr/share/bendloop/parts /usr/share/bendloop/register-maps /etc/bendloop/
cp one_bend.toml /etc/bendloop/parts/
echo "# wired by the integrator" >>/etc/bendloop/register-maps/default.toml
cell_of Upgraded 7420 1502 >/etc/bendloop/cell.toml
cat >program.json <<'JSON'
{"rows": [{"length_mm": 110, "rotation_deg": 0, "angle_deg": 60, "bend_radius_mm": 20},
  {"length_mm": 120, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}
JSON
machines_on program.json 200
systemctl enable --now bendloopd >enable.log 2>&1 || fail "the service does not start: $(cat enable.log)"
whole_part
whole_part
was=$(sequence)
pid=$(systemctl show -p MainPID --value bendloopd)
settings=$(cd /etc/bendloop && sha256sum cell.toml parts/one_bend.toml register-maps/default.toml)
sums=$(cd /var/lib/bendloop && sha256sum results/*.json sessions/*.session)
echo "$(results) parts, the bender's program is $was"

step "Today's package over it, while the service runs"
apt-get -q -y -o Dpkg::Options::=--force-confold install ./bendloop_0.[2-9]*.deb >upgrade.log 2>&1 || fail "$(cat upgrade.log)"
[ "$(dpkg-query -W -f '${Version}' bendloop)" != 0.1.0 ] || fail "nothing was upgraded: $(cat upgrade.log)"
since=$(cut -d . -f 1 /proc/uptime)
await 120 "the service, up by itself" systemctl --quiet is-active bendloopd
echo "up $(($(cut -d . -f 1 /proc/uptime) - since)) s after apt"
[ "$(systemctl show -p MainPID --value bendloopd)" != "$pid" ] || fail "the old program runs still"
systemctl --quiet is-enabled bendloopd || fail "the service is not enabled any more"
await_ready
[ "$(sequence)" = "$was" ] || fail "the upgrade sent a program"
[ "$(cd /etc/bendloop && sha256sum cell.toml parts/one_bend.toml register-maps/default.toml)" = "$settings" ] ||
  fail "the upgrade changed settings"
echo "$sums" >sums
(cd /var/lib/bendloop && sha256sum --quiet -c /root/sums) || fail "the upgrade changed data"
! bendloop status | grep -E '^alarm BL(501[01]|4002|1001|4001)' || fail "the old state was not taken up"
echo "settings, results and sessions as they were"

step "The next part is measured and corrected, and all counts on"
whole_part
is=$(sequence)
[ "$is" -gt "$was" ] || fail "sequence $was became $is"
bendloop history --config /etc/bendloop/cell.toml --csv - >history.csv
cut -d , -f 1-3,5,7,8 history.csv
for name in part-0001 part-0002 part-0003; do
  [ "$(grep -c "^$name,.*,committed," history.csv)" = 1 ] || fail "$name is not in the history once"
done
[ "$(find /var/lib/bendloop -name '*.damaged-*' | wc -l)" = 0 ] || fail "a database was moved aside"
systemctl stop bendloopd
[ "$(systemctl show -p Result --value bendloopd)" = success ] || fail "did not stop well"
[ "$(number journal.db)" -gt 1 ] || fail "the journal is still of version $(number journal.db)"
[ "$(number history.db)" -gt 1 ] || fail "the history is still of version $(number history.db)"
echo "journal and history of versions $(number journal.db) and $(number history.db), with all that was in them"
step "done"
