#!/bin/sh
# What two runs of the same step have in common: numbers, their signs, digests and the width of blanks and
# rules do not count, nor do empty lines.
# usage: mask.sh <TEXT
exec sed -E -e 's/\b[0-9a-f]{8,}\b/#/g' -e 's/[-+]?[0-9]+([.,:][0-9]+)*/#/g' -e 's/-{2,}/--/g' \
  -e 's/[[:blank:]]+/ /g' -e 's/^ //; s/ $//' -e '/^$/d'
