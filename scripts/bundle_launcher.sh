#!/bin/sh
# Starts the harmzone of the folder that this file is in, with the Python of that folder and no other.
set -eu
here=$(dirname "$(readlink -f "$0")")
needed=@GLIBC@

fail() {
    echo "harmzone: $*" >&2
    exit 1
}

[ "$(uname -sm)" = "Linux x86_64" ] || fail "this folder is for Linux on x86-64; this is $(uname -sm)"
[ -e /lib64/ld-linux-x86-64.so.2 ] || fail "this system has no glibc; needed is glibc $needed or newer"
# Where getconf is not installed, the loader itself refuses a glibc that is too old.
found=$(getconf GNU_LIBC_VERSION 2>/dev/null) && found=${found#glibc } || found=$needed
oldest=$(printf '%s\n%s\n' "$needed" "$found" | sort -V | head -n 1)
[ "$oldest" = "$needed" ] || fail "this system has glibc $found; needed is glibc $needed or newer"

unset PYTHONPATH PYTHONSTARTUP PYTHONPLATLIBDIR PYTHONOPTIMIZE PYTHONINSPECT
export PYTHONHOME="$here" HARMZONE_VENV="$here" PYTHONNOUSERSITE=1 PYTHONDONTWRITEBYTECODE=1
exec "$here/bin/harmzone" "$@"
