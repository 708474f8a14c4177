#!/usr/bin/env bash
# Fills corpus/<target>/ with inputs to begin with: made in code, and from files of this repository.
# SAMPLES=FOLDER adds real files (kitti/, av2/, opendrive/); RUNS="FOLDER.." adds folders of scores and drives.
set -euo pipefail
cd "$(dirname "$0")"
programs=${PROGRAMS:-target/x86_64-unknown-linux-gnu/release}
most_bytes=200000

# seed TARGET KIND FILE..: each file with its first byte.
seed() {
    local target=$1 kind=$2 file
    shift 2
    for file in "$@"; do
        [ -s "$file" ] && [ "$(stat -Lc %s "$file")" -le "$most_bytes" ] || continue
        mkdir -p "corpus/$target"
        { printf "\\x$(printf %02x "$kind")"; cat "$file"; } >"corpus/$target/file_${kind}_$(basename "$(dirname "$file")")_$(basename "$file")"
    done
}

for program in fuzz_targets/*.rs; do
    target=$(basename "$program" .rs)
    HARMZONE_SEEDS_TO=corpus/$target "$programs/$target"
    [ -d "seeds/$target" ] && cp "seeds/$target"/* "corpus/$target/"
done

seed road 0 ../scenes/*/road.xodr ../tests/data/*.xodr
seed road 1 ../scenes/*/town.toml ../scenes/default_town.toml
seed road 3 ../scenes/*/town.toml

configs=(gen train zone rig eval sweep drive model import ros2_mapping models scenario overrides)
for kind in "${!configs[@]}"; do
    name=${configs[$kind]}
    case $name in
        gen) files=(../configs/gen.toml ../tests/data/paper_scaled_down.toml) ;;
        train) files=(../configs/train*.toml) ;;
        rig) files=(../configs/rigs/*.toml) ;;
        model) files=(../configs/model/*.toml ../tests/data/paper_scaled_down.toml) ;;
        import) files=(../configs/import/{av2,kitti,nuscenes,ros2}.toml) ;;
        ros2_mapping) files=(../configs/import/ros2_mapping.toml ../tests/data/ros2/plain_mapping.toml) ;;
        scenario) files=(../scenarios/*_1.toml) ;;
        models) files=() ;;
        overrides) files=() ;;
        *) files=("../configs/$name.toml") ;;
    esac
    [ ${#files[@]} -eq 0 ] || seed config "$kind" "${files[@]}"
done
printf '\x0a[defaults]\nunit = "cm"\n[models.chair]\nup = "y"\nmass_kg = 4\n' >corpus/config/made_models
printf '\x0cseed=3\nscene.ood=true\ntowns=["market"]\nrig.cameras.cam_front.width_px=640\n' >corpus/config/made_overrides

seed predictions 0 ../tests/golden/nuscenes_*.{predictions,truth}.json
seed mesh 0 ../mjcf_assets/{bin,bench,barrier,sofa*,chair*}/*.obj
seed mesh 4 ../mjcf_assets/*/*.png
seed mesh 7 ../mjcf_assets/{bin,bench,barrier}/model.xml
seed checkpoint 0 ../tests/golden/{assignment,losses,swin_t}.safetensors
seed image_weights 0 ../tests/golden/swin_weights_* ../tests/golden/lss_fpn.safetensors
python3 - <<'PY'
import pathlib, zipfile
out = pathlib.Path("corpus/image_weights")
out.mkdir(parents=True, exist_ok=True)
for path in sorted(pathlib.Path("../tests/golden").glob("swin_weights_*.pt*")):
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as file:
            name = next(name for name in file.namelist() if name.endswith("data.pkl"))
            (out / f"pickle_{path.name}").write_bytes(b"\x01" + file.read(name))
PY

samples=${SAMPLES:-}
if [ -d "$samples" ]; then
    seed road 0 "$samples"/opendrive/*.xodr
    for file in "$samples"/kitti/training/label_2/*.txt; do seed predictions 2 "$file"; seed import_kitti 66 "$file"; done
    for file in "$samples"/kitti/training/calib/*.txt; do seed import_kitti 64 "$file"; done
    seed import_av2 3 "$samples"/av2/*/city_SE3_egovehicle.feather
    seed import_av2 4 "$samples"/av2/*/map/*.json
else
    echo "make_corpus.sh: NO REAL SAMPLES: SAMPLES is \`$samples\`, not a folder with kitti/, av2/ and opendrive/" >&2
fi
for run in ${RUNS:-}; do
    kind=0
    for name in metrics.json source.json faults.json sweeps.json results.json drive.json log.csv validation.csv; do
        [ -f "$run/$name" ] && seed results $kind "$run/$name"
        kind=$((kind + 1))
    done
done
for folder in corpus/*; do echo "$(find "$folder" -type f | wc -l) inputs in $folder"; done
