#!/bin/sh
# A state directory that version 0.1.0 wrote (state-0.1.0/) under today's daemon: its databases are brought to today's
# versions, nothing of them is lost, and parts, programs and names count on.
# usage: upgrade_state.sh BUILD
set -eu
build=$(realpath "$1")
kind=killed
here=$(dirname -- "$(realpath "$0")")
# shellcheck source=tests/vm/daemon_cell.sh disable=SC2034,SC2154
. "$here/daemon_cell.sh"
old=$here/state-0.1.0
version() { sqlite3 "state/$1" 'PRAGMA user_version'; }

machines_on
mkdir -p state/results
for database in journal history; do sqlite3 "state/$database.db" <"$old/$database.sql" >/dev/null; done
cp "$old/lot.json" state
cp "$old/part-0001.json" state/results
was="$(version journal.db) $(version history.db)"
now_step="today's daemon on it"
start
! grep -E '^alarm BL(501[01]|4002)' status.now || fail "the old state was taken for damaged"
corrected_part
stop
now_step="what it made of it"
[ -s state/results/part-0002.json ] || fail "names do not count on: $(ls state/results)"
journal() { sqlite3 state/journal.db "$1"; }
[ "$(journal "SELECT count(*) FROM attempt WHERE session IN ('part-0001', 'part-0002')")" = 2 ] ||
  fail "the journal has lost an attempt"
[ "$(journal "SELECT count(*) FROM step WHERE step = 'committed'")" = 2 ] || fail "the journal has lost a commit"
"$build/bin/bendloop" history --config cell.toml --csv - >history.csv
for name in part-0001 part-0002; do grep -q "^$name," history.csv || fail "no $name in the history: $(cat history.csv)"; done
[ "$(find state -name '*.damaged-*' | wc -l)" = 0 ] || fail "a database was moved aside"
echo "journal and history of versions $was are of $(version journal.db) $(version history.db), with all that was in them;" \
  "part-0002 measured and corrected"
