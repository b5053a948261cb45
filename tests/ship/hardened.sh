#!/bin/sh
# Fails if a program is not position independent, has a table that may be written after its start
# (no full RELRO), an executable stack, or neither stack protector nor checked string functions.
# usage: hardened.sh PROGRAM...
set -eu
failed=0
for program in "$@"; do
  wrong=
  readelf -hW "$program" | grep -q 'Type:.*DYN' || wrong="$wrong; not position independent"
  readelf -lW "$program" | grep -q GNU_RELRO || wrong="$wrong; no RELRO"
  readelf -dW "$program" | grep -q BIND_NOW || wrong="$wrong; no BIND_NOW"
  ! readelf -lW "$program" | grep -q 'GNU_STACK.*RWE' || wrong="$wrong; executable stack"
  symbols=$(readelf --dyn-syms -W "$program")
  case $symbols in *__stack_chk_fail*) ;; *) wrong="$wrong; no stack protector" ;; esac
  case $symbols in *_chk@*) ;; *) wrong="$wrong; no _FORTIFY_SOURCE" ;; esac
  if [ -n "$wrong" ]; then
    echo "$program: ${wrong#; } (expected of every program that ships: CMakeLists.txt)" >&2
    failed=1
  else
    echo "$program: hardened"
  fi
done
exit "$failed"
