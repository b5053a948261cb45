#!/bin/sh
# What the programs consist of, as SPDX 2.3 (JSON): each Debian package whose shared
# library they load, whose archive was linked into them, or whose headers were compiled into them.
# usage: sbom.sh BUILD VERSION DATE FILE PROGRAM...   DATE: of the commit, RFC 3339; programs as ninja knows them
# SYSROOT and EMULATOR in the environment, for a build for another processor: where its packages lie, and
# what runs its programs.
# Where licences.txt does not know one it says so, here and in the file; tests/ship fails then.
set -eu
build=$1
version=$2
date=$3
file=$4
shift 4
here=$(dirname -- "$(realpath "$0")")
sysroot=${SYSROOT:-}
if [ -n "$sysroot" ]; then export DPKG_ADMINDIR="$sysroot/var/lib/dpkg"; fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$build"

# Where /lib is a link to /usr/lib, dpkg may know a file by either name.
owners() { # of the files in $1, one "PACKAGE" a line
  { cat "$1"; sed -n "s#^$sysroot/usr/lib/#$sysroot/lib/#p" "$1"
    sed -n "s#^$sysroot/lib/#$sysroot/usr/lib/#p" "$1"; } | sort -u |
    xargs -r dpkg-query -S 2>/dev/null | sed 's/: .*//; s/,.*//' | sort -u
}

# Loaded: all that the loader finds, whoever wanted it.
loaded() { # by a program, as ldd does it
  # shellcheck disable=SC2086  # EMULATOR is a command with its words
  if [ -n "$sysroot" ]; then ${EMULATOR:-} -E LD_TRACE_LOADED_OBJECTS=1 "$1"; else ldd "$1"; fi
}
for program in "$@"; do loaded "$program"; done |
  sed -n "s#.*=> \(/[^ ]*\) .*#$sysroot\1#p" | sort -u >"$work/loaded"
owners "$work/loaded" | sed 's/$/ DYNAMIC_LINK/' >"$work/packages"
# Linked in, and compiled in: the compiler's own list of what each object read.
ninja -t inputs "$@" >"$work/inputs"
grep '^/.*\.a$' "$work/inputs" >"$work/static" || true
ninja -t deps >"$work/deps"
awk 'FNR == NR { ours[$1] = 1; next } /^[^ ].*: #deps/ { sub(/:$/, "", $1); on = ours[$1]; next }
  on { print $1 }' "$work/inputs" "$work/deps" | sort -u | xargs -r realpath -sm |
  grep "^$sysroot/usr/include/" >>"$work/static"
# The report's page.
grep -h '^BENDLOOP_THREE_JS' CMakeCache.txt | sed 's/.*=//' >>"$work/static"
owners "$work/static" | sed 's/$/ STATIC_LINK/' >>"$work/packages"

# A package's runtime and development halves are one component; the C library and the compiler's own are
# shared libraries, whatever of their headers was read.
while read -r package how; do
  dpkg-query -W -f '${source:Package} ${source:Version} ${Package} ${Version} ${Architecture}'" $how\n" "$package"
done <"$work/packages" | awk '
  $1 == "linux" { next }                                # the kernel as it is called, not its code
  ($1 == "glibc" || $1 ~ /^gcc-/ || $1 == "libxcrypt") && $6 == "STATIC_LINK" { next }
  $6 == "STATIC_LINK" && seen[$1] == "DYNAMIC_LINK" && $3 ~ /-dev$/ && $1 != "ceres-solver" { next }
  { seen[$1] = $6; if (!done[$3]++) print }' | sort -k 3 >"$work/components"

awk -v version="$version" -v date="$date" '
  FNR == NR { if ($1 !~ /^#/ && NF > 1) { name = $1; sub(/^[^ ]* /, ""); licence[name] = $0 } next }
  {
    if (!($1 in licence)) {
      print "sbom.sh: licences.txt has no licence of " $1 " (" $3 "): give it one" > "/dev/stderr"
      licence[$1] = "NOASSERTION"
    }
    id = $3; gsub(/[^A-Za-z0-9.-]/, "-", id)
    packages = packages sprintf(",\n    {\"SPDXID\": \"SPDXRef-%s\", \"name\": \"%s\", \"versionInfo\": \"%s\", \"supplier\": \"Organization: Debian\", \"downloadLocation\": \"NOASSERTION\", \"filesAnalyzed\": false, \"licenseConcluded\": \"%s\", \"licenseDeclared\": \"NOASSERTION\", \"copyrightText\": \"NOASSERTION\", \"sourceInfo\": \"%s %s\", \"externalRefs\": [{\"referenceCategory\": \"PACKAGE-MANAGER\", \"referenceType\": \"purl\", \"referenceLocator\": \"pkg:deb/debian/%s@%s?arch=%s\"}]}", id, $3, $4, licence[$1], $1, $2, $3, $4, $5)
    relations = relations sprintf(",\n    {\"spdxElementId\": \"SPDXRef-bendloop\", \"relationshipType\": \"%s\", \"relatedSpdxElement\": \"SPDXRef-%s\"}", $6, id)
  }
  END {
    print "{\n  \"spdxVersion\": \"SPDX-2.3\", \"dataLicense\": \"CC0-1.0\", \"SPDXID\": \"SPDXRef-DOCUMENT\","
    print "  \"name\": \"bendloop-" version "\", \"documentNamespace\": \"https://bendloop.invalid/spdx/bendloop-" version "-" date "\","
    print "  \"creationInfo\": {\"created\": \"" date "\", \"creators\": [\"Tool: bendloop-sbom\"]},"
    print "  \"packages\": [\n    {\"SPDXID\": \"SPDXRef-bendloop\", \"name\": \"bendloop\", \"versionInfo\": \"" version "\", \"downloadLocation\": \"NOASSERTION\", \"filesAnalyzed\": false, \"licenseConcluded\": \"Apache-2.0\", \"licenseDeclared\": \"Apache-2.0\", \"copyrightText\": \"NOASSERTION\"}" packages "\n  ],"
    print "  \"relationships\": [\n    {\"spdxElementId\": \"SPDXRef-DOCUMENT\", \"relationshipType\": \"DESCRIBES\", \"relatedSpdxElement\": \"SPDXRef-bendloop\"}" relations "\n  ]\n}"
  }' "$here/licences.txt" "$work/components" >"$work/bom"
mv "$work/bom" "$file"
