#!/usr/bin/env bash
# `make drives`: the closed loop of docs/drive.md, of the network inside the program and its rivals: 300 drawn worlds, the suite of
# scenarios and, with DRIVES_FINAL=1, split test. Hours; safe to run again: finished drives are kept, and the rest is driven.
#
#   NETWORK       folder of the data and runs of `make network` and `make network-rivals` [runs/network]
#   DRIVES_OUT    folder of the drives [runs/drives]
#   DRIVES_FINAL  1: also split test, which is to report, once
#   DRIVES_TOY    1: a few drives of each, to try the script
set -euo pipefail
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release/harmzone
network=${NETWORK:-runs/network}
out=${DRIVES_OUT:-runs/drives}
worlds=(--preset small --ood --episodes 300 --seed 77001)
test_worlds=(--preset small --ood --episodes 150 --split test --final)
suite=(--scenarios suite)
if [ "${DRIVES_TOY:-0}" = 1 ]; then
    out=${DRIVES_OUT:-runs/drives-toy}
    worlds=(--preset small --ood --episodes 2 --seed 77001 --set seconds=3)
    # What is for reporting is not for trying.
    test_worlds=("${worlds[@]}")
    suite=(--scenarios scenarios/bag_beside_1.toml)
fi

for run in lidar kinds; do
    if [ ! -f "$network/$run/model.safetensors" ]; then
        echo "no $network/$run/model.safetensors: \`make network-rivals\` trains it" >&2
        exit 1
    fi
done

# scores JUDGE RUN: the scores from which a rule over a network's boxes brakes hard and warns, as those of a network are chosen.
scores() {
    "$bin" calibrate "$2" --judge "$1" --data "$network/val" --json --quiet | .venv/bin/python -c '
import json, sys
chosen = json.load(sys.stdin)
print(chosen["braking_score"]["score"], chosen["operating_score"]["score"], sep=",")'
}
zone=$(scores zone small)
kinds=$(scores zone-expected "$network/kinds")
who=(blind truth small "zone=zone:small@$zone" "lidar=$network/lidar" "kinds=zone-expected:$network/kinds@$kinds")
echo "drivers: ${who[*]}" >&2

"$bin" drive "${who[@]}" "${worlds[@]}" --record-worst 10 --out "$out/worlds"
"$bin" drive "${who[@]}" "${suite[@]}" --no-record --out "$out/suite"
if [ "${DRIVES_FINAL:-0}" = 1 ]; then
    "$bin" drive "${who[@]}" "${test_worlds[@]}" --no-record --out "$out/test"
fi
