#!/bin/sh
# Checks the model of the commit protocol with spin: it holds, and without any one of its precautions
# it does not (else the model has gone blind).
# usage: check_model.sh MODEL.pml FOLDER [FAULTS]
#   FOLDER  for spin's files; made anew
#   FAULTS  how many things go wrong in one run; 3
# Exits 0 if all is as it must be, 77 without spin.
set -eu
model=$(realpath "$1")
folder=$2
faults=${3:-3}

if ! command -v spin >/dev/null || ! command -v gcc >/dev/null; then
  echo "NOT CHECKED: the model of the commit protocol needs spin and gcc (apt-get install spin gcc)" >&2
  exit 77
fi
rm -rf "$folder"
mkdir -p "$folder"
cd "$folder"

# search FAULTS [SPIN-OPTION...]: spin's report; exits 0 if no claim is broken
search() {
  count=$1
  shift
  spin -DFAULTS="$count" "$@" -a "$model" >spin.txt || { cat spin.txt; exit 1; }
  gcc -O$optimise -DSAFETY -DCOLLAPSE -DNOFAIR -o pan pan.c
  ./pan -m100000 -w20 >report.txt
  if grep -q -e 'max search depth too small' -e 'out of memory' report.txt; then
    cat report.txt
    exit 1
  fi
  grep -q 'errors: 0' report.txt
}

optimise=2
if ! search "$faults"; then
  cat report.txt
  spin -DFAULTS="$faults" -t -p "$model" | grep 'proc ' | tail -80
  echo "the commit protocol's model breaks a claim (above)"
  exit 1
fi
echo "holds with $faults faults: $(sed -n 's/^ *\([0-9.e+]* states, stored\).*/\1/p' report.txt)"
optimise=0  # these end soon
for precaution in NO_CRC NO_DISARM LEAVE_STAGED COMMIT_FIRST REPEAT FORGETFUL STAGED_STAYS; do
  if search 3 -DMUTANT_$precaution; then
    echo "MUTANT_$precaution: no claim is broken; the model does not see what this precaution is for"
    exit 1
  fi
  echo "fails as it must with MUTANT_$precaution: $(grep -m 1 -o 'assertion violated.*' report.txt)"
done
