#!/usr/bin/env bash
# A data set made by a Slurm array and joined by a job after it.
# Usage: submit.sh OUT SHARDS GEN_ARGUMENTS...
#   deploy/slurm/submit.sh /scratch/big 200 --preset small --ood --episodes 10000 --seed 7
# The number of shards is part of what is asked for: keep it when tasks are sent again.
set -euo pipefail
if [ $# -lt 2 ] || ! [[ $2 =~ ^[1-9][0-9]*$ ]]; then
    echo "usage: $0 OUT SHARDS GEN_ARGUMENTS..." >&2
    exit 2
fi
here=$(cd "$(dirname "$0")" && pwd)
OUT=$(realpath -m "$1") SHARDS=$2
shift 2
export OUT SHARDS
mkdir -p "$OUT/shards"
array=$(sbatch --parsable --export=ALL --array="0-$((SHARDS - 1))" "$here/gen.sbatch" "$@")
array=${array%%;*}
merge=$(sbatch --parsable --export=ALL --dependency="afterok:$array" "$here/merge.sbatch")
echo "shards: job $array, 0 to $((SHARDS - 1)); the data set $OUT/data: job ${merge%%;*}"
