#!/usr/bin/env bash
# `make drives`: the closed loop of docs/drive.md, of the network inside the program and its rivals: 300 drawn worlds, the suite of
# scenarios and, with DRIVES_FINAL=1, split test; each with a page. Hours; safe to run again: finished drives are kept, and the rest
# is driven, by the program of the first time: its copy lies in the folder of the drives, with the commit in made_by.txt.
#
#   NETWORK       folder of the data and runs of `make network` and `make network-rivals` [runs/network]
#   DRIVES_OUT    folder of the drives [runs/drives]
#   DRIVES_FINAL  1: also split test, which is to report, once
#   DRIVES_SCORES 1: also the network at six scores in 72 of the worlds, against its open loop: what that foretells
#   DRIVES_TOY    1: a few drives of each, to try the script
set -euo pipefail
# What fails within $(..) ends the script, too.
shopt -s inherit_errexit
cd "$(dirname "$0")/.."

network=${NETWORK:-runs/network}
toy=${DRIVES_TOY:-0}
out=${DRIVES_OUT:-runs/drives}
if [ "$toy" = 1 ]; then out=${DRIVES_OUT:-runs/drives-toy}; fi
worlds=(--preset small --ood --episodes 300 --seed 77001)
# The seed of split test is that of configs/results.toml.
test_worlds=(--preset small --ood --episodes 150 --split test --final --seed 1018)
suite=(--scenarios suite)
score_worlds=(--preset small --ood --episodes 72 --seed 77001)
open_loop=(--preset small --episodes 48 --samples 20 --set sample_period_s=0.3 --ood --seed 72003)
if [ "$toy" = 1 ]; then
    worlds=(--preset small --ood --episodes 2 --seed 77001 --set seconds=3)
    # What is for reporting is not for trying.
    test_worlds=("${worlds[@]}")
    suite=(--scenarios scenarios/bag_beside_1.toml)
    score_worlds=("${worlds[@]}")
    open_loop=(--preset small --episodes 2 --samples 4 --set sample_period_s=0.3 --ood --seed 72003)
fi

# trained RUN KEY VALUE: that a run is finished, and trained as its name says.
trained() {
    if [ ! -f "$network/$1/model.safetensors" ]; then
        echo "no $network/$1/model.safetensors: \`make network-rivals\` and \`make network-seed\` train it" >&2
        exit 1
    fi
    if [ "$toy" != 1 ] && ! grep -q "^$2 = $3\$" "$network/$1/train.toml"; then
        echo "$network/$1/train.toml has no line \`$2 = $3\`: another network lies there" >&2
        exit 1
    fi
}
# calibrated RUN: that the score is in it from which it brakes hard; without one a network brakes from .2, whatever that costs.
calibrated() {
    if [ "$toy" != 1 ] && ! grep -qa harmzone.braking "$network/$1/model.safetensors"; then
        echo "$network/$1: nobody chose the score from which it brakes: harmzone calibrate $network/$1 --data $network/val" >&2
        exit 1
    fi
}
trained lidar use_camera false
calibrated lidar
trained kinds classes '"kind"'
# What ships, from other seeds of its training, on split test.
seeds=()
if [ "${DRIVES_FINAL:-0}" = 1 ] && [ "$toy" != 1 ]; then
    for seed in 1 2; do
        trained "seed-$seed" seed $seed
        calibrated "seed-$seed"
        seeds+=("seed-$seed=$network/seed-$seed")
    done
fi

# The program of the first time, whatever is built meanwhile; a run on split test is of one program.
mkdir -p "$out"
bin=$out/harmzone
export HARMZONE_VENV=${HARMZONE_VENV:-$PWD/.venv}
if [ ! -f "$bin" ]; then
    cp "${CARGO_TARGET_DIR:-target}/release/harmzone" "$bin.partial"
    { echo "commit $(git describe --always --dirty --abbrev=40)"; sha256sum <"$bin.partial"; } >"$out/made_by.txt"
    mv "$bin.partial" "$bin"
fi

# scores JUDGE RUN CHECKPOINT: the scores from which a rule over a network's boxes brakes hard and warns, as those of a network are
# chosen. Kept by what they were chosen for: a driver of other scores, were it in the last digit, is another driver.
scores() {
    local key kept
    key=$(cat "$bin" "$3" "$network/val/dataset.json" | sha256sum)
    kept="$out/scores/$1-${key:0:12}"
    if [ ! -s "$kept" ]; then
        mkdir -p "$out/scores"
        "$bin" calibrate "$2" --judge "$1" --data "$network/val" --json --quiet | .venv/bin/python -c '
import json, sys
chosen = json.load(sys.stdin)
print(chosen["braking_score"]["score"], chosen["operating_score"]["score"], sep=",")' >"$kept.partial"
        mv "$kept.partial" "$kept"
    fi
    cat "$kept"
}
zone=zone:small@$(scores zone small models/small.safetensors)
kinds=zone-expected:$network/kinds@$(scores zone-expected "$network/kinds" "$network/kinds/model.safetensors")
# The rule that judges the boxes of the closed set, over those of what ships: what boxes trained for harm are worth under one rule.
expected=zone-expected:small@$(scores zone-expected small models/small.safetensors)
who=(blind truth small "zone=$zone" "lidar=$network/lidar" "kinds=$kinds")
echo "drivers: ${who[*]}" >&2

# Where a drive failed, what the others did is still told (exit code 3), and so is that at the end.
failed=0
try() { "$bin" "$@" || { local code=$?; [ $code = 3 ] || exit $code; failed=3; }; }
# A page can be made again at any time: one that fails stops no drive.
page() { "$bin" report "$@" --force || failed=3; }
# keep_first FILE: drive.json of split test as it first was; a second call drives anew what failed in the first, and writes another.
keep_first() { [ -f "$1" ] || cp "$out/test/drive.json" "$1"; }

try drive "${who[@]}" "${worlds[@]}" --record-worst 10 --out "$out/worlds"
page "$out/worlds.html" --drives "$out/worlds" --cards 10
try drive "${who[@]}" "${suite[@]}" --no-record --out "$out/suite"
page "$out/suite.html" --drives "$out/suite" --cards 0
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
    page "$out/scores-of-small.html" --drives "$out/scores-of-small" --ood "$out/open" --cards 0
fi
if [ "${DRIVES_FINAL:-0}" = 1 ]; then
    # Two networks under one rule, first: a table sets all its detectors beside the first of them.
    try drive "expected=$expected" "kinds=$kinds" "${test_worlds[@]}" --no-record --out "$out/test"
    keep_first "$out/test-rule.json"
    try drive "${who[@]}" "expected=$expected" "${seeds[@]}" "${test_worlds[@]}" --no-record --out "$out/test"
    keep_first "$out/test.json"
    page "$out/test.html" --drives "$out/test" --cards 0
fi
exit $failed
