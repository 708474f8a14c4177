#!/usr/bin/env bash
# Installs the wheel into a fresh venv and runs its tests there, or another script. Usage: try_wheel.sh WHEELS PROGRAM [SCRIPT]
set -euo pipefail
program=$(realpath "$2")
wheel=$(realpath "$1"/harmzone-*.whl)
what=(-m pytest -q -p no:cacheprovider "$(dirname "$(realpath "$0")")/../tests/wheel")
if [ $# -gt 2 ]; then what=("$(realpath "$3")"); fi
cd "$(dirname "$0")/.."
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
.venv/bin/python -m venv "$folder/venv"
"$folder/venv/bin/python" -m pip install --disable-pip-version-check --quiet "$wheel[ray]" pytest
"$folder/venv/bin/python" -m pip check
# PyTorch is half a gigabyte, so it is taken from where it is.
golden=$(echo "$PWD"/.venv-golden/lib/python3*/site-packages)
if [ -d "$golden/torch" ]; then
    echo "$golden" >"$(echo "$folder"/venv/lib/python3*/site-packages)/zz_golden.pth"
else
    echo "NO PYTORCH: its part is not tried; \`make setup-golden\` brings it" >&2
fi
# Nothing of the source tree or of a virtual environment named elsewhere.
cd "$folder"
env -u HARMZONE_VENV -u PYTHONPATH HARMZONE_PROGRAM="$program" PATH="$folder/venv/bin:/usr/bin:/bin" \
    venv/bin/python "${what[@]}"
