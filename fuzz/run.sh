#!/usr/bin/env bash
# Runs fuzz targets in turn, one process at the lowest priority, until the hours are over or it is stopped.
#
#   fuzz/run.sh TARGET.. --hours H    or `all`; corpus/ and artifacts/ stay, so that a later run goes on
#   TIMEOUT_S=120 fuzz/run.sh ..       on a busy machine: an input may take so long by the clock [20]
#   fuzz/run.sh --total               hours, executions and faults of all runs so far, by target
#   fuzz/run.sh TARGET.. --minimise   of each corpus only the smallest inputs that reach as much
#
# hours.csv gets a line a slice: target, seconds, seconds of the processor, executions, new inputs, faults, when it ended, and how many of
# the executions were of the corpus, which each slice begins with. It is kept in the repository, so that hours of several machines add up.
# What counts in the total are seconds of the processor, which beside other work are fewer, and of these the share that went to new
# inputs; of older lines, which do not tell the share, those that found something new.
set -euo pipefail
cd "$(dirname "$0")"
programs=${PROGRAMS:-target/x86_64-unknown-linux-gnu/release}
slice_s=${SLICE_S:-300}
# By the wall clock: on a busy machine an input needs more.
timeout_s=${TIMEOUT_S:-20}
log=hours.csv

if [ "${1:-}" = --total ]; then
    [ -f "$log" ] || { echo "there is no $PWD/$log yet" >&2; exit 1; }
    awk -F, 'NR > 1 { share = NF > 7 ? ($4 > $8 ? ($4 - $8) / $4 : 0) : $5 > 0
                     t = share * $3; s[$1] += t; n[$1] += $4; c[$1] += $5; f[$1] += $6; S += t; N += $4; C += $5; F += $6 }
        END { printf "%-16s %8s %12s %10s %7s\n", "target", "hours", "executions", "new inputs", "faults"
              for (t in s) printf "%-16s %8.2f %12d %10d %7d\n", t, s[t] / 3600, n[t], c[t], f[t] | "sort"
              close("sort")
              printf "%-16s %8.2f %12d %10d %7d\n", "all", S / 3600, N, C, F }' "$log"
    exit
fi

targets=()
hours=1
minimises=
while [ $# -gt 0 ]; do
    case $1 in
        --hours) hours=$2; shift ;;
        --minimise) minimises=yes ;;
        all) for file in fuzz_targets/*.rs; do targets+=("$(basename "$file" .rs)"); done ;;
        *) targets+=("$1") ;;
    esac
    shift
done
[ ${#targets[@]} -gt 0 ] || { sed -n '2,8p' "$0"; exit 2; }
if [ -n "$minimises" ]; then
    for target in "${targets[@]}"; do
        rm -rf "corpus/$target.less"
        mkdir -p "corpus/$target.less"
        RAYON_NUM_THREADS=1 HARMZONE_LOG=off nice -n 19 "$programs/$target" -merge=1 "-timeout=$timeout_s" -rss_limit_mb=2048 \
            -max_len=200000 "corpus/$target.less" "corpus/$target" >/dev/null 2>&1
        echo "$target: $(find "corpus/$target.less" -type f | wc -l) of $(find "corpus/$target" -type f | wc -l) inputs"
        rm -rf "corpus/$target"
        mv "corpus/$target.less" "corpus/$target"
    done
    exit
fi
[ -f "$log" ] || echo "target,seconds,cpu_seconds,executions,new_inputs,faults,ended,replayed" >"$log"

head -1 "$log" | grep -q cpu_seconds || { echo "$PWD/$log is of an older run.sh, without cpu_seconds: move it away" >&2; exit 1; }

# Seconds of the processor that ended children of this shell have had, in `cpu`; a subshell has none.
count_cpu() {
    times >"$scratch/times"
    cpu=$(awk 'NR == 2 { split($0, t, /[ms ]+/); printf "%d", t[1] * 60 + t[2] + t[3] * 60 + t[4] }' "$scratch/times")
}

# Inputs that were faults; one that was only slow, on a machine that had no time for it, is none.
n_faults() { find "artifacts/$target" -type f ! -name 'slow-unit-*' | wc -l; }

end=$(($(date +%s) + $(awk "BEGIN { printf \"%d\", $hours * 3600 }")))
scratch=$(mktemp -d -p "$([ -d /dev/shm ] && echo /dev/shm || echo "${TMPDIR:-/tmp}")" harmzone-fuzz.XXXXXX)
trap 'rm -rf "$scratch"' EXIT
while [ "$(date +%s)" -lt "$end" ]; do
    for target in "${targets[@]}"; do
        begin=$(date +%s)
        left=$((end - begin))
        [ "$left" -gt 5 ] || break
        # A fault ends libFuzzer: the slice goes on with a new process, but not for ever with the same fault.
        slice_end=$((begin + (left < slice_s ? left : slice_s)))
        for _ in 1 2 3 4 5; do
            begin=$(date +%s)
            [ $((slice_end - begin)) -gt 5 ] || break
            mkdir -p "corpus/$target" "artifacts/$target" "$scratch/$target"
            dictionary=()
            [ -f "dictionaries/$target.dict" ] && dictionary=("-dict=dictionaries/$target.dict")
            before=$(n_faults)
            count_cpu
            cpu_before=$cpu
            TMPDIR="$scratch/$target" RAYON_NUM_THREADS=1 HARMZONE_LOG=off nice -n 19 "$programs/$target" \
                "corpus/$target" "-artifact_prefix=artifacts/$target/" -max_total_time=$((slice_end - begin)) \
                -timeout=$timeout_s -report_slow_units=$timeout_s -rss_limit_mb=2048 -malloc_limit_mb=1024 -max_len=200000 -print_final_stats=1 \
                "${dictionary[@]}" >"$scratch/$target.log" 2>&1 || true
            rm -rf "${scratch:?}/$target"
            count_cpu
            stat_of() { sed -n "s/^stat::$1: *//p" "$scratch/$target.log" | tail -1; }
            executions=$(stat_of number_of_executed_units)
            new=$(stat_of new_units_added)
            replayed=$(sed -n 's/^#\([0-9]*\).*INITED.*/\1/p' "$scratch/$target.log" | tail -1)
            faults=$(($(n_faults) - before))
            echo "$target,$(($(date +%s) - begin)),$((cpu - cpu_before)),${executions:-0},${new:-0},$faults,$(date -u +%FT%TZ),${replayed:-${executions:-0}}" >>"$log"
            [ "$faults" -gt 0 ] || break
            mkdir -p artifacts/logs
            tail -n 60 "$scratch/$target.log" >"artifacts/logs/$target-$(date +%s).log"
        done
    done
done
