#!/usr/bin/env bash
# Builds the wheel and the bundle twice, from two clones of the same commit in folders of different names, and compares
# what comes out, byte for byte. Called by `make reproducible`. Usage: check_reproducible.sh [wheel] [bundle]
#
# Compiles everything anew, four times: an hour or more on two cores. JOBS=1 leaves cores to others. The clones are below
# $TMPDIR and are removed at the end; KEEP=1 keeps them, to look for what differs.
set -euo pipefail
cd "$(dirname "$0")/.."
source=$PWD
parts=("$@")
[ ${#parts[@]} -gt 0 ] || parts=(wheel bundle)

say() { echo "reproducible: $*" >&2; }
fail() {
    say "$*"
    exit 1
}

for part in "${parts[@]}"; do
    case $part in wheel | bundle) ;; *) fail "no part is called $part; there are wheel and bundle" ;; esac
done
commit=$(git rev-parse HEAD)
[ -z "$(git status --porcelain --untracked-files=no)" ] || say "uncommitted changes are not in it; compared is $commit"

work=$(mktemp -d)
if [ -z "${KEEP:-}" ]; then trap 'rm -rf "$work"' EXIT; else say "the clones stay in $work"; fi
# Of different length, so that a path that gets into a file moves what is behind it.
clones=("$work/first" "$work/a-second-one")
for clone in "${clones[@]}"; do
    git clone --quiet --no-local "$source" "$clone"
    git -C "$clone" checkout --quiet --detach "$commit"
    for part in "${parts[@]}"; do
        say "$part in $clone"
        start=$SECONDS
        # Neither the calling make's settings nor a target folder that both would share.
        env -u MAKEFLAGS -u MAKELEVEL -u CARGO_TARGET_DIR -u RUSTFLAGS -u SOURCE_DATE_EPOCH \
            ${JOBS:+CARGO_BUILD_JOBS="$JOBS"} make -C "$clone" "$part" >"$work/log" 2>&1 ||
            fail "make $part failed in $clone: $(tail -n 40 "$work/log")"
        say "$part took $((SECONDS - start)) s"
    done
done

# files_of PART: what it consists of, by path in the clone
files_of() {
    case $1 in
    wheel) find dist/wheels -type f ;;
    bundle) find dist/harmzone-x86_64-linux -type f -o -type l ;;
    esac | LC_ALL=C sort
}

# sums_of PART: a line for each file: its hash, its permissions and its path
sums_of() {
    files_of "$1" | while read -r file; do
        echo "$(sha256sum <"$file" | cut -c 1-64) $(stat -c %a "$file") $file"
    done
}

differing=0
printf '%-7s  %6s  %10s  %-64s  %s\n' part files bytes "SHA-256 of all files' hashes" result
for part in "${parts[@]}"; do
    for i in 0 1; do (cd "${clones[$i]}" && sums_of "$part") >"$work/$part.$i"; done
    [ -s "$work/$part.0" ] || fail "make $part left nothing to compare"
    result=same
    cmp -s "$work/$part.0" "$work/$part.1" || result=DIFFERS
    for i in 0 1; do
        n_bytes=$(cd "${clones[$i]}" && files_of "$part" | tr '\n' '\0' | xargs -0 stat -c %s | awk '{ n += $1 } END { print n }')
        printf '%-7s  %6d  %10d  %-64s  %s\n' "$part" "$(wc -l <"$work/$part.$i")" "$n_bytes" \
            "$(sha256sum <"$work/$part.$i" | cut -c 1-64)" "$result"
    done
    if [ $result = DIFFERS ]; then
        differing=1
        diff "$work/$part.0" "$work/$part.1" | grep '^[<>]' | sort -k 4 || true
    fi
done
exit $differing
