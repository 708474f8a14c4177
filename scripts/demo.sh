#!/usr/bin/env bash
# `make demo`: the whole pipeline, small, in demo/. Safe to run again: finished parts are kept or resumed.
set -euo pipefail
cd "$(dirname "$0")/.."

harmzone="${CARGO_TARGET_DIR:-target}/release/harmzone"
out=demo
times=()

# part NAME COMMAND...: runs it under a heading and keeps its time.
part() {
    local name=$1 start=$SECONDS
    shift
    printf '\n== %s\n' "$name" >&2
    "$@"
    times+=("$(printf '  %6d s  %s' $((SECONDS - start)) "$name")")
}

train() {
    "$harmzone" train "$out/id" --out "$out/run"
}

# Samples that the detector was not trained on: every sixth episode, and all of the OOD set.
draw() {
    local data=$1 sample
    shift
    mkdir -p "$out/pictures"
    for sample in "$@"; do
        "$harmzone" view "$out/$data" --sample "$sample" --predictions "$out/run" \
            --out "$out/pictures/$data-$sample.png" --force
    done
}

begin=$SECONDS
part "setup" make --no-print-directory setup
part "compile" make --no-print-directory build
compiled=$SECONDS

# Every sixth episode is kept for validation: 20 x 15 samples to train on, 4 x 15 to validate.
part "generate, in distribution" "$harmzone" gen --preset demo --out "$out/id"
part "generate, out of distribution" "$harmzone" gen --preset demo --ood --out "$out/ood"
part "label, in distribution" "$harmzone" label "$out/id"
part "label, out of distribution" "$harmzone" label "$out/ood"
part "train" train
part "predict, in distribution" "$harmzone" predict "$out/run" --data "$out/id" --force
part "predict, out of distribution" "$harmzone" predict "$out/run" --data "$out/ood" --force
part "score, in distribution" "$harmzone" eval "$out/run" --data "$out/id" --out "$out/eval-id" --force
part "score, out of distribution" "$harmzone" eval "$out/run" --data "$out/ood" --ood --out "$out/eval-ood" --force
# The network inside the program, trained by `make network`, beside the one of minutes above.
part "score the network that comes with harmzone, in distribution" \
    "$harmzone" eval small --data "$out/id" --out "$out/eval-small-id" --force
part "score the network that comes with harmzone, out of distribution" \
    "$harmzone" eval small --data "$out/ood" --ood --out "$out/eval-small-ood" --force
for run in eval eval-small; do
    part "report of $run" "$harmzone" report "$out/$run.html" --id "$out/$run-id" --ood "$out/$run-ood" --force
done
part "pictures, in distribution" draw id 76 86 166 176 256 266 346 356
part "pictures, out of distribution" draw ood 3 12 18 27 33 42 50 57 70 80 95 110

cat <<END

== Out of distribution: trained here in minutes
$(head -n 10 "$out/eval-ood/table.txt")

== Out of distribution: the network that comes with harmzone
$(head -n 10 "$out/eval-small-ood/table.txt")

Time
$(printf '%s\n' "${times[@]}")
  $(printf '%6d s  setup and compilation' $((compiled - begin)))
  $(printf '%6d s  all the rest' $((SECONDS - compiled)))

Results, all in $out/
  id/ ood/              episodes (open the .mcap files in Foxglove or Rerun), labels beside them
  run/                  the trained detector and its resolved config
  eval-id/ eval-ood/    metrics.json and the tables printed above
  eval-small-id/ eval-small-ood/    the same of the network that comes with harmzone
  eval.html eval-small.html    both as a page each: tables, curves, the worst misses and false alarms in pictures
  pictures/             camera and bird's-eye views with zone, truth and predictions
END
