#!/usr/bin/env bash
# `make paper-run`: the data, the training and the scores of the profile `paper` on a GPU, with what each stage took. Safe to run
# again: finished stages are kept, begun ones go on.
#
#   PAPER_DEVICE  device, or devices with commas between [cuda:0]
#   PAPER_OUT     folder of data, run and scores [runs/paper]
#   PAPER_PRICE   what an hour of this machine costs, for the cost of a step [none]
#   PAPER_WINDOW  episodes of a window of the stream, 0: all in memory [128]
#   PAPER_STEPS   steps that the profile times [20]
#   PAPER_TOY     1: everything in little on the CPU, to try the script
#
# Pictures are rendered by EGL on the GPU that MUJOCO_EGL_DEVICE_ID names, by as many processes as there are cores.
set -euo pipefail
cd "$(dirname "$0")/.."

out=${PAPER_OUT:-runs/paper}
device=${PAPER_DEVICE:-cuda:0}
window=${PAPER_WINDOW:-128}
steps=${PAPER_STEPS:-20}
price=${PAPER_PRICE:-}
data=(--preset paper)
size=() size_ood=() training=()
model=paper
if [ "${PAPER_TOY:-0}" = 1 ]; then
    out=${PAPER_OUT:-runs/paper-toy}
    device=${PAPER_DEVICE:-cpu}
    window=${PAPER_WINDOW:-2}
    steps=${PAPER_STEPS:-2}
    data=(--preset paper --set samples=3 --set val_every=2 --set "towns=[\"downtown\"]")
    size=(--episodes 6) size_ood=(--episodes 2)
    model=tests/data/paper_scaled_down.toml
    # `--model FILE` has the default's training; the schedule in little is the paper's otherwise.
    training=(--config configs/train-paper.toml --set batch_size=2 --set accumulate=2
        --set lidar_stage.epochs=1 --set fused_stage.epochs=1)
fi

# A GPU needs its backend in the build.
features=()
case $device in
    *cuda*) features=(--features cuda) ;;
    *vulkan*) features=(--features vulkan) ;;
esac
cargo build --release --workspace "${features[@]}" --bins
bin=${CARGO_TARGET_DIR:-target}/release
mkdir -p "$out"
times=$out/times.tsv

# part NAME COMMAND...: runs a stage unless it is done, and keeps the seconds of all its calls.
part() {
    local name=$1 start=$SECONDS
    shift
    if grep -q "^done	$name$" "$times" 2>/dev/null; then
        printf '== %s: done\n' "$name" >&2
        return
    fi
    printf '\n== %s\n' "$name" >&2
    # Killed or not, the time counts.
    trap 'printf "time\t%s\t%s\n" "$name" $((SECONDS - start)) >>"$times"' EXIT
    "$@"
    trap - EXIT
    printf 'time\t%s\t%s\ndone\t%s\n' "$name" $((SECONDS - start)) "$name" >>"$times"
}

quietly_to() {
    local file=$1
    shift
    "$@" >"$file.partial"
    mv "$file.partial" "$file"
}

first_device=${device%%,*}
part "generate, in distribution" "$bin/harmzone" gen "${data[@]}" "${size[@]}" --out "$out/id"
part "generate, out of distribution" "$bin/harmzone" gen "${data[@]}" --ood "${size_ood[@]}" --out "$out/ood"
part "label, in distribution" "$bin/harmzone" label "$out/id"
part "label, out of distribution" "$bin/harmzone" label "$out/ood"
part "train" "$bin/harmzone" train "$out/id" --model "$model" "${training[@]}" --set "stream.window_episodes=$window" \
    --device "$device" --out "$out/run"
part "profile of a step" quietly_to "$out/profile.txt" "$bin/xtask" bench-model --data "$out/id" --device "$first_device" \
    --steps "$steps" --samples "$steps" --config "$out/run/train.toml" --model "$out/run"
part "score, in distribution" "$bin/harmzone" eval "$out/run" --data "$out/id" --device "$first_device" \
    --out "$out/eval-id" --force
part "score, out of distribution" "$bin/harmzone" eval "$out/run" --data "$out/ood" --ood --device "$first_device" \
    --out "$out/eval-ood" --force

PAPER_PRICE=$price PAPER_DEVICE=$device python3 scripts/paper_table.py "$out" | tee "$out/RESULTS_ROW.md"
