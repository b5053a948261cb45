# shellcheck shell=sh disable=SC2034,SC2154
# What the scripts share that end a daemon hard, here (daemon_cell.sh) or in a guest (appliance_resets.sh): a simulated
# bender and a scanner that go on, and the judging of what an end left. Sourced, with build, here, kind (killed, honest
# or lying: daemon_cell.sh), rate (of the scanner, profiles per second) and log (what a failure shows, in work) set.
# Exits with 77 where it cannot be had. Makes the folder work, which whoever sources it removes, and goes there.
# Brings telling.sh along.
PATH=$PATH:/usr/sbin:/sbin
skip() {
  echo "############ NOT TRIED: $* ############" >&2
  exit 77
}
need() { # need TOOL...
  for tool in "$@"; do
    command -v "$tool" >/dev/null || skip "$tool is missing; config/install-packages.sh test"
  done
}
need python3 sqlite3
work=$(mktemp -d)
bender_program='' scanner_program='' bender_port=''
# shellcheck source=tests/vm/telling.sh
. "$here/telling.sh"
# await SECONDS WHAT COMMAND...: until it succeeds. The command may await something in its turn, so that what is
# remembered here lies in arguments.
await() {
  set -- $(($(date +%s) + $1)) "$@"
  until await_once "$@"; do
    [ "$(date +%s)" -lt "$1" ] || fail "awaited for $2 s, and not seen: $3"
    sleep 0.05
  done
}
await_once() { # await_once END SECONDS WHAT COMMAND...
  shift 3
  "$@"
}
said() { grep -q "$1" "$2"; } # said WORDS FILE
now_ms() { date +%s%3N; }
chance() { echo "$1" | cksum | awk '{ printf "%.4f", $1 % 10000 / 10000 }'; } # chance WORD: of 0 to 1, the same for the same
port_of() { sed -n 's/^listening //p' "$1.out"; }                             # port_of bender|scanner

bender_on() {
  echo '{"rows": [{"length_mm": 110, "rotation_deg": 0, "angle_deg": 60, "bend_radius_mm": 20},
  {"length_mm": 120, "rotation_deg": 0, "angle_deg": 0, "bend_radius_mm": null}]}' >program.json
  mkfifo bender.in
  mkdir tray
  : >bender.out
  "$build/bin/bendloop-simbender" --map "$here/../../config/register-maps/default.toml" --tray tray \
    --program program.json --part-number 7 --pipe-radius 4 --springback-20 1.2 --springback-120 3.6 \
    --elongation 1.5 --scatter-angle 0.3 <bender.in >>bender.out 2>&1 &
  bender_program=$!
  exec 3>bender.in
  await 120 "a bender that listens" said listening bender.out
  bender_port=$(port_of bender)
}
# has_done_all: whoever talked with the bender has gone, and it has read, and done, all that they had sent. What was on its
# way when the other end was killed is done when the bender comes to it, however long this machine keeps it waiting.
has_done_all() {
  awk -v port=":$(printf %04X "$bender_port")\$" '
    BEGIN { listens = "0A"; was_closed = "06" }
    $2 ~ port && $4 != listens && $4 != was_closed { is_open = 1 }
    END { exit is_open }' /proc/net/tcp
}
scanner_on() { # scanner_on PORT (0: any)
  rm -f scanner.in
  mkfifo scanner.in
  : >scanner.out
  "$build/bin/bendloop-simscanner" --port "$1" --spacing 1 --rays 160 --views 2 --rate "$rate" <scanner.in \
    >>scanner.out 2>&1 &
  scanner_program=$!
  exec 4>scanner.in
  await 120 "a scanner that listens" said listening scanner.out
}
machines_off() { # for whoever cleans up
  for child in $bender_program $scanner_program; do kill -9 "$child" 2>/dev/null || true; done
}
# ask: the bender's active sequence, and how many commits it has taken
ask() {
  : >bender.out
  echo status >&3
  await 120 "the bender's answer" said 'accepted [0-9]' bender.out
  sequence=$(sed -n 's/.*sequence \([0-9]*\).*/\1/p' bender.out | head -n 1)
  rows=$(sed -n 's/.*rows \([0-9]*\).*/\1/p' bender.out | head -n 1)
  accepted=$(sed -n 's/.*accepted \([0-9]*\).*/\1/p' bender.out | head -n 1)
}
part=0
bend() {
  part=$((part + 1))
  tube=tray/part-$(printf %04d "$part").json
  echo bend >&3
  await 120 "part $part on the tray" test -e "$tube"
}
scan() { # returns when the first profiles are on their way
  : >scanner.out
  echo "scan $tube" >&4
  await 120 "scan of part $part" said scanning scanner.out
  scan_began_ms=$(now_ms)
  profiles=$(sed -n 's/^scanning .* \([0-9]*\) profiles$/\1/p' scanner.out)
}

# In the middle of a scan for as long as it takes: the scanner stands still there. Who does something to a scan that runs
# comes too late where this machine keeps him waiting for a second.
held_profiles=200
scan_held() {
  echo "misbehave stall 3600000 after $held_profiles" >&4
  scan
}
go_on() { echo "go on" >&4; }

# judge_start: what `ask` tells is as it was before the start, sequence and commits in `began`. A commit that was on its
# way when the end came is settled, not sent again.
judge_start() {
  [ "$sequence $accepted" = "$began" ] ||
    fail "the start itself sent: sequence and commits $began became $sequence $accepted"
}
# judge_program: since `was` and `taken` one program at most was taken, whole; counts those in `sent`
sent=0
judge_program() {
  [ "$rows" = 2 ] || fail "the bender holds $rows rows"
  case $((accepted - taken)) in
  0) [ "$sequence" = "$was" ] || fail "sequence $was became $sequence, and no commit was taken" ;;
  1)
    [ "$sequence" -gt "$was" ] || fail "a commit was taken, and sequence $was became $sequence"
    sent=$((sent + 1))
    ;;
  *) fail "$((accepted - taken)) commits in one part" ;;
  esac
}
# judge_session SESSIONS: how much of the scan that was ended at cut_ms is not in its session: lost_ms, of what the scanner
# had sent; most_lost_ms is the largest so far. newest: the last session there is, by its name.
newest=
lost_ms=0
most_lost_ms=0
judge_session() {
  before=$newest
  newest=$(find "$1" -name 'part-*.session' | sed 's#.*/##' | sort -V | tail -n 1)
  kept=0
  if [ "$newest" != "$before" ] && [ "$(printf '%s\n%s\n' "$before" "$newest" | sort -V | tail -n 1)" = "$newest" ]; then
    mkdir copy # with its log, which reading it would change
    cp "$1/$newest"* copy
    kept=$(sqlite3 "copy/$newest" 'SELECT count(*) FROM profile' 2>/dev/null || echo 0)
    rm -r copy
  fi
  due=$(((cut_ms - scan_began_ms) * rate / 1000))
  [ "$due" -lt "$profiles" ] || due=$profiles
  lost_ms=$(((due - kept) * 1000 / rate))
  [ "$lost_ms" -gt 0 ] || lost_ms=0
  [ "$lost_ms" -lt "$most_lost_ms" ] || most_lost_ms=$lost_ms
}
# judge_state FOLDER: after a clean stop all of it is sound, and agrees with the bender
judge_state() {
  sessions=0
  for database in "$1"/*.db "$1"/sessions/*.session; do
    [ "$(sqlite3 "$database" 'PRAGMA integrity_check')" = ok ] || fail "$database is not sound"
  done
  for session in "$1"/sessions/*.session; do
    sessions=$((sessions + 1))
    "$build/bin/bendloop" check "$session" >check.log 2>&1 || true
    ! grep -i 'damaged\|checksum\|malformed' check.log || fail "$session is damaged"
  done
  results=$(find "$1/results" -name '*.json' | wc -l)
  open=$(sqlite3 "$1/journal.db" "SELECT count(*) FROM attempt WHERE (SELECT step FROM step
    WHERE step.attempt = attempt.id ORDER BY step.id DESC LIMIT 1) IN ('begun', 'committing')")
  [ "$open" = 0 ] || fail "$open attempts are open in the journal"
  committed=$(sqlite3 "$1/journal.db" "SELECT count(*) FROM step WHERE step = 'committed'")
  # On a disk that lies the journal may not know of what it was about to write, nor the history of what the journal knows.
  [ "$committed" = "$accepted" ] || [ "$kind" = lying ] ||
    fail "the bender took $accepted commits, the journal knows of $committed"
  twice=$(sqlite3 "$1/history.db" "SELECT count(*) - count(DISTINCT session) FROM part")
  [ "$twice" = 0 ] || fail "$twice parts stand in the history twice"
  missing=$(sqlite3 "$1/journal.db" "ATTACH '$1/history.db' AS history; SELECT count(*) FROM attempt
    WHERE session NOT IN (SELECT session FROM history.part)")
  [ "$missing" = 0 ] || [ "$kind" = lying ] || fail "$missing parts of the journal are not in the history"
}
cd "$work" || exit
