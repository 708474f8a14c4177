#!/usr/bin/env bash
# `make beside-results`: what RESULTS.md does not hold of split test, of the data sets that `make results ARGS=--final` made: each
# group of towns apart, the network against those of the repository's history and against perfect boxes, the closed set by its
# open-set scores. An hour or two on two cores; safe to run again: what is done is kept. The tables lie in $RESULTS/beside/*/versus.txt.
#
#   NETWORK  folder of the data and runs of `make network` and `make network-rivals` [runs/network]
#   RESULTS  folder of `make results` [runs/results]
#   SPLIT    test; another split of other sets is for trying [test]
#   SETS     names of the data sets, each with and without -ood [test test-maps]
set -euo pipefail
# What fails within $(..) ends the script, too.
shopt -s inherit_errexit
cd "$(dirname "$0")/.."

bin=${CARGO_TARGET_DIR:-target}/release/harmzone
network=${NETWORK:-runs/network}
results=${RESULTS:-runs/results}
split=${SPLIT:-test}
read -ra sets <<<"${SETS:-test test-maps}"
out=$results/beside
mkdir -p "$out"

seeds=("$network/run")
for run in "$network"/seed-*; do
    if [ -f "$run/model.safetensors" ]; then seeds+=("$run"); fi
done

# Networks that shipped before: of data version 1, and network 10. Each checkpoint is read from the commit that held it.
shipped() {
    local file=$out/$1.safetensors
    if [ ! -f "$file" ]; then
        git show "$2:models/small.safetensors" >"$file.partial"
        mv "$file.partial" "$file"
    fi
    echo "$file"
}
version_1=$(shipped version-1 b5139ff0)
network_10=$(shipped network-10 7fdea40b)

# boxes NAME RUN DATA: a network's boxes of a data set, once.
boxes() {
    local folder
    folder=$out/boxes/$(basename "$3")/$1
    if [ ! -f "$folder/predictions.json" ]; then
        "$bin" predict "$2" --data "$3" --split "$split" --out "$folder" --force >&2
    fi
    echo "$folder/predictions.json"
}

# beside NAME DATA OOD DETECTORS..: side by side, once.
beside() {
    local name=$1 data=$2 ood=$3
    shift 3
    local folder
    folder=$out/$(basename "$data")-$name
    if [ ! -f "$folder/versus.json" ]; then
        "$bin" versus "$@" --data "$data" --split "$split" ${ood:+$ood} --out "$folder" --force
    fi
}

for set in "${sets[@]}"; do
    for ood in "" --ood; do
        data=$results/$set${ood:+-ood}
        if [ ! -f "$data/dataset.json" ]; then
            echo "no $data: left out" >&2
            continue
        fi
        small=()
        for run in "${seeds[@]}"; do
            file=$(boxes "$(basename "$run")" "$run" "$data")
            small+=("small=$file")
        done
        of_version_1=$(boxes version-1 "$version_1" "$data")
        of_network_10=$(boxes network-10 "$network_10" "$data")
        beside history "$data" "$ood" "version-1=$of_version_1" "network-10=$of_network_10" "${small[@]}" truth
        dark=()
        for run in "${seeds[@]}"; do
            dark+=("dark=camera-blind:$run")
        done
        lidar=$(boxes lidar "$network/lidar" "$data")
        camera=$(boxes camera "$network/camera" "$data")
        beside sensors "$data" "$ood" "lidar=$lidar" "camera=$camera" "${dark[@]}" "${small[@]}"
        closed=()
        for score in msp energy mahalanobis; do
            folder=$out/boxes/$(basename "$data")/closed-$score
            if [ ! -f "$folder/predictions.json" ]; then
                "$bin" baseline "closed-$score" "$network/kinds" --data "$data" --split "$split" --fit "$network/train" \
                    --out "$folder" --force >&2
            fi
            closed+=("$score=$folder/predictions.json")
        done
        beside kinds "$data" "$ood" "kinds=zone-expected:$network/kinds" "${closed[@]}" "zone=zone-expected:$network/run" "${small[@]}"
    done
done
for table in "$out"/*/versus.txt; do echo "$table"; done
