# A guide's blocks: a script that runs them in order, and what they must show.
# usage: awk -v out=FOLDER -f extract.awk GUIDE
#   ```sh              a step: into FOLDER/steps.sh
#   ```sh hands        a step for a machine that the test has not: into FOLDER/hands-LINE.sh, looked at only
#   ```text            what the step before it shows: into FOLDER/N.expected
#   <!-- hands: X -->  what somebody does in between, here by hands.sh
#   <!-- picture: F -->  the step before it shows what the picture shows: FOLDER/N.picture names it
BEGIN { steps = out "/steps.sh"; step = 0; printf "" > steps }
/^```/ {
  if (kind != "") { kind = ""; next }
  if ($0 == "```sh") { kind = "sh"; ++step; printf "step %d %d\n", step, NR + 1 >> steps; next }
  if ($0 == "```sh hands") { kind = "hands"; file = out "/hands-" NR + 1 ".sh"; printf "" > file; next }
  if ($0 == "```text") {
    if (step == 0) { print FILENAME ":" NR ": shows the output of no step"; failed = 1; exit 1 }
    kind = "text"; file = out "/" step ".expected"
    next
  }
  kind = "other"
  next
}
kind == "sh" { print >> steps; next }
kind == "hands" || kind == "text" { print > file; next }
kind == "" && /^<!-- hands: .* -->$/ {
  sub(/^<!-- hands: /, ""); sub(/ -->$/, "")
  print >> steps
}
kind == "" && /^<!-- picture: .* -->$/ { print $3 > (out "/" step ".picture") }
END {
  if (!failed && kind != "") { print FILENAME ": a block has no end"; exit 1 }
  print "step 0 0" >> steps
}
