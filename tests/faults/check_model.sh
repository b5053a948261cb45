#!/bin/sh
# Checks a model of the commit with spin: it holds, and without any one of its precautions it does not
# (else the model has gone blind).
# usage: check_model.sh MODEL.pml FOLDER [FAULTS]
#   MODEL   has a line "// holds with: OPTIONS" for each search, one "// fails with: OPTIONS", and a
#           macro MUTANT_... for each precaution that can be taken away
#   FOLDER  for spin's files; made anew
#   FAULTS  how many things go wrong in one run; as the model's lines say
# Exits 0 if all is as it must be, 77 without spin.
set -eu
model=$(realpath "$1")
folder=$2
faults=${3:-}
name=$(basename "$model")

if ! command -v spin >/dev/null || ! command -v gcc >/dev/null; then
  echo "NOT CHECKED: $name needs spin and gcc (apt-get install spin gcc)" >&2
  exit 77
fi
rm -rf "$folder"
mkdir -p "$folder"
cd "$folder"

# search SPIN-OPTION...: spin's report; exits 0 if no claim is broken
search() {
  spin "$@" -a "$model" >spin.txt || { cat spin.txt; exit 1; }
  gcc -w -O$optimise -DSAFETY -DCOLLAPSE -DNOFAIR -o pan pan.c
  ./pan -m100000 -w22 >report.txt
  if grep -q -e 'max search depth too small' -e 'out of memory' report.txt; then
    cat report.txt
    exit 1
  fi
  grep -q 'errors: 0' report.txt
}

# lines WORDS: the options that the model gives after these words
lines() {
  sed -n "s,^// $1 with: ,,p" "$model" | sed "s/-DFAULTS=[0-9]*/-DFAULTS=${faults:-&}/; s/-DFAULTS=-/-/"
}

optimise=2
lines holds >holds.txt
while read -r options; do
  # shellcheck disable=SC2086  # options are words
  if ! search $options; then
    cat report.txt
    # shellcheck disable=SC2086
    spin $options -t -k "$name.trail" -p "$model" | grep 'proc ' | tail -80
    echo "$name breaks a claim with $options (above)"
    exit 1
  fi
  echo "holds with $options: $(sed -n 's/^ *\([0-9.e+]* states, stored\).*/\1/p' report.txt)"
done <holds.txt
optimise=0  # these end before an optimised search is compiled
options=$(lines fails)
mutants=$(grep -o 'MUTANT_[A-Z_]*' "$model" | sort -u)
[ -s holds.txt ] && [ -n "$mutants" ]
for mutant in $mutants; do
  # shellcheck disable=SC2086
  if search $options "-D$mutant"; then
    echo "$mutant: no claim is broken; $name does not see what this precaution is for"
    exit 1
  fi
  echo "fails as it must with $mutant: $(grep -m 1 -o 'assertion violated.*' report.txt)"
done
