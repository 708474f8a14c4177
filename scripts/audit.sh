#!/usr/bin/env bash
# Are faults known of the crates that harmzone is made of? Called by `make audit` and `make ci`. Usage: audit.sh CARGO_DENY
#
# RustSec's database is fetched into cargo-deny's cache folder, $CARGO_HOME/advisory-dbs. Without network the copy there
# is used and its age told; without a copy nothing is checked, which is told, and is a failure with AUDIT=required.
# AUDIT=offline fetches no database.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo_deny=$1

say() { echo "audit: $*" >&2; }

databases="${CARGO_HOME:-$HOME/.cargo}/advisory-dbs"
fetched=no
if [ "${AUDIT:-}" != offline ]; then
    # Without a terminal to ask at, git fails at once where it would want a password.
    if reason=$(GIT_TERMINAL_PROMPT=0 timeout 300 "$cargo_deny" fetch db 2>&1); then
        fetched=yes
    else
        say "RustSec's database cannot be fetched: $(grep -m 1 fatal <<<"$reason" || tail -n 1 <<<"$reason")"
    fi
fi

n_databases=0
for database in "$databases"/advisory-db-*/; do
    date_s=$(git -C "$database" log -1 --format=%ct 2>/dev/null) || continue
    n_databases=$((n_databases + 1))
    say "RustSec's database of $(date -u -d "@$date_s" +%F), $((($(date +%s) - date_s) / 86400)) days old," \
        "$(find "$database/crates" -name 'RUSTSEC-*.md' 2>/dev/null | wc -l) advisories"
done
if [ "$n_databases" = 0 ]; then
    say "***** SKIPPED: NO ADVISORY WAS LOOKED UP. *****"
    say "There is no database in $databases. With network, \`make audit\` fetches it."
    [ "${AUDIT:-}" != required ] || exit 1
    exit 0
fi
[ "$fetched" = yes ] || say "an older copy: newer advisories are not in it"

# cargo-deny reads the sources of all crates of Cargo.lock; offline it cannot fetch one that is missing.
cargo fetch --locked --quiet || say "some crates cannot be fetched"
"$cargo_deny" --offline check advisories
