#!/usr/bin/env bash
# `make drives`: the closed loop of docs/drive.md, of the network inside the program and its rivals: 300 drawn worlds, the suite of
# scenarios and, with DRIVES_FINAL=1, split test; each with a page. Hours; safe to run again: finished drives are kept, and the rest
# is driven.
#
#   NETWORK       folder of the data and runs of `make network` and `make network-rivals` [runs/network]
#   DRIVES_OUT    folder of the drives [runs/drives]
#   DRIVES_FINAL  1: also split test, which is to report, once
#   DRIVES_SCORES 1: also the network at six scores in 72 of the worlds, against its open loop: what that foretells
#   DRIVES_TOY    1: a few drives of each, to try the script
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release/harmzone
network=${NETWORK:-runs/network}
out=${DRIVES_OUT:-runs/drives}
worlds=(--preset small --ood --episodes 300 --seed 77001)
# The seed of split test is that of configs/results.toml.
test_worlds=(--preset small --ood --episodes 150 --split test --final --seed 1018)
suite=(--scenarios suite)
score_worlds=(--preset small --ood --episodes 72 --seed 77001)
open_loop=(--preset small --episodes 48 --samples 20 --set sample_period_s=0.3 --ood --seed 72003)
if [ "${DRIVES_TOY:-0}" = 1 ]; then
    out=${DRIVES_OUT:-runs/drives-toy}
    worlds=(--preset small --ood --episodes 2 --seed 77001 --set seconds=3)
    # What is for reporting is not for trying.
    test_worlds=("${worlds[@]}")
    suite=(--scenarios scenarios/bag_beside_1.toml)
    score_worlds=("${worlds[@]}")
    open_loop=(--preset small --episodes 2 --samples 4 --set sample_period_s=0.3 --ood --seed 72003)
fi

for run in lidar kinds; do
    if [ ! -f "$network/$run/model.safetensors" ]; then
        echo "no $network/$run/model.safetensors: \`make network-rivals\` trains it" >&2
        exit 1
    fi
done

# scores JUDGE RUN CHECKPOINT: the scores from which a rule over a network's boxes brakes hard and warns, as those of a network are
# chosen. Kept by what they were chosen for: a driver of other scores, were it in the last digit, is another driver.
scores() {
    local key kept
    key=$(cat "$3" "$network/val/dataset.json" | sha256sum)
    kept="$out/scores/$1-${key:0:12}"
    if [ ! -f "$kept" ]; then
        mkdir -p "$out/scores"
        "$bin" calibrate "$2" --judge "$1" --data "$network/val" --json --quiet | .venv/bin/python -c '
import json, sys
chosen = json.load(sys.stdin)
print(chosen["braking_score"]["score"], chosen["operating_score"]["score"], sep=",")' >"$kept.partial"
        mv "$kept.partial" "$kept"
    fi
    cat "$kept"
}
zone=$(scores zone small models/small.safetensors)
kinds=$(scores zone-expected "$network/kinds" "$network/kinds/model.safetensors")
who=(blind truth small "zone=zone:small@$zone" "lidar=$network/lidar" "kinds=zone-expected:$network/kinds@$kinds")
echo "drivers: ${who[*]}" >&2

# Where a drive failed, what the others did is still told (exit code 3), and so is that at the end.
failed=0
try() { "$bin" "$@" || { local code=$?; [ $code = 3 ] || exit $code; failed=3; }; }

try drive "${who[@]}" "${worlds[@]}" --record-worst 10 --out "$out/worlds"
try report "$out/worlds.html" --drives "$out/worlds" --cards 10 --force
try drive "${who[@]}" "${suite[@]}" --no-record --out "$out/suite"
try report "$out/suite.html" --drives "$out/suite" --cards 0 --force
if [ "${DRIVES_SCORES:-0}" = 1 ]; then
    drivers=(blind truth)
    for score in .2 .3 .43 .53 .62 .75; do
        drivers+=("small$score=small@$score,$score")
    done
    try drive "${drivers[@]}" "${score_worlds[@]}" --no-record --out "$out/scores-of-small"
    try gen --out "$out/open-data" "${open_loop[@]}"
    try label "$out/open-data"
    try eval small --data "$out/open-data" --ood --out "$out/open" --force \
        --set 'safety.false_alarms_per_km=[1,3,10,30,100,300]'
    try report "$out/scores-of-small.html" --drives "$out/scores-of-small" --ood "$out/open" --cards 0 --force
fi
if [ "${DRIVES_FINAL:-0}" = 1 ]; then
    try drive "${who[@]}" "${test_worlds[@]}" --no-record --out "$out/test"
    try report "$out/test.html" --drives "$out/test" --cards 0 --force
fi
exit $failed
