#!/usr/bin/env bash
# A whole experiment in small, minutes on two cores; larger numbers make it a real one. Each command goes on where it
# stopped when it is called again.
set -euo pipefail
cd "$(dirname "$0")"

# Drives to train on, and drives with things that no training set holds.
harmzone gen --out data/id --config gen.toml --town all --weather all --episodes 12 --samples 10 --seed 1
harmzone gen --out data/ood --config gen.toml --ood --town all --weather all --episodes 4 --samples 10 --seed 2

# What is harmful: inside the danger zone.
harmzone label data/id --zone zone.toml
harmzone label data/ood --zone zone.toml

# The detector: two short epochs; without `--set`, those of train.toml.
harmzone train data/id --out runs/first --config train.toml --set fused_stage.epochs=2

# Scores with what is known and with what is not, and one page of both.
harmzone eval runs/first --data data/id --config eval.toml --out runs/first/scores/id --force
harmzone eval runs/first --data data/ood --ood --config eval.toml --out runs/first/scores/ood --force
harmzone report runs/first/report.html --id runs/first/scores/id --ood runs/first/scores/ood --force
echo "look at runs/first/report.html, or: harmzone serve ."
