# shellcheck shell=sh
# Sourced by what makes a Debian root of its own: where this machine's packages come from.

# The Debian mirror: MIRROR of the environment, else the first of apt's one-line or deb822 sources.
host_mirror() {
  mirror=${MIRROR:-$({
    cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list 2>/dev/null |
      awk '$1 == "deb" { sub(/^deb +(\[[^]]*\] +)?/, ""); if ($2 ~ /^bookworm/) print $1 }'
    cat /etc/apt/sources.list.d/*.sources 2>/dev/null |
      awk '/^URIs:/ { uri = $2 } /^Suites:/ && / bookworm( |$)/ { print uri }'
  } | head -n 1)}
  echo "${mirror:-http://deb.debian.org/debian}"
}

# How apt reaches it (proxies, keys), as mmdebstrap's --aptopt takes it from a file.
host_apt_settings() { apt-config dump | grep -E '^Acquire::(http|https|Retries)' || true; }
