#!/usr/bin/env bash
# Makes the project's Python venv and what it needs from the system; called by `make setup`,
# `make setup-test`, `make setup-golden`, `make bundle`, `make wheel`, `make check-logs`, `make check-mmdet3d`,
# `make lock` and `make sbom`.
# Usage: setup.sh product|test|golden|logs|mmdet3d|bundle|wheel|supply
#
# Debian and Ubuntu as root: missing system packages are installed. Elsewhere: the command to run is printed.
set -euo pipefail
cd "$(dirname "$0")/.."

say() { echo "setup: $*" >&2; }
fail() {
    echo "setup: $*" >&2
    exit 1
}

# system_packages WHY PACKAGE...
system_packages() {
    local why=$1
    shift
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        say "$why is missing; installing: $*"
        apt-get update -qq
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
    else
        fail "$why is missing. Install it, then run this again. On Debian or Ubuntu:
    sudo apt-get install $*"
    fi
}

# Can this interpreter be embedded (of a version that the lists have hashes for, shared libpython with its link name) and
# make a venv?
usable() {
    "$1" - >/dev/null 2>&1 <<'PYTHON'
import ensurepip, os, sys, sysconfig, venv
get = sysconfig.get_config_var
folders = [get("LIBDIR") or "", os.path.join(get("LIBDIR") or "", get("MULTIARCH") or "")]
linkable = any(os.path.exists(os.path.join(folder, get("LDLIBRARY") or "none")) for folder in folders)
headers = os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h"))
sys.exit(not ((3, 11) <= sys.version_info[:2] <= (3, 14) and get("Py_ENABLE_SHARED") and linkable and headers))
PYTHON
}

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
        if command -v "$candidate" >/dev/null && usable "$candidate"; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# make_venv FOLDER REQUIREMENTS
make_venv() {
    local folder=$1 requirements=$2 python
    if ! "$folder/bin/python" -c '' 2>/dev/null; then
        if ! python=$(find_python); then
            [ -z "${PYTHON:-}" ] || fail "PYTHON=$PYTHON is not Python 3.11 to 3.14 with a shared libpython and headers"
            system_packages "Python 3.11 to 3.14 with venv, headers and a shared libpython" python3-venv python3-dev
            python=$(find_python) || fail "no Python 3.11 to 3.14 with a shared libpython; name one: PYTHON=... make setup"
        fi
        say "making $folder with $python"
        rm -rf "$folder"
        "$python" -m venv "$folder"
    fi
    say "installing $requirements into $folder"
    install_pinned "$folder" "$requirements"
}

# install_pinned VENV REQUIREMENTS: the lists pin every package, so pip resolves nothing (--no-deps), and takes no file
# whose hash is not in the list.
install_pinned() {
    "$1/bin/python" -m pip install --disable-pip-version-check --quiet --no-deps --require-hashes -r "$2" ||
        fail "$2 cannot be installed; see above. If a hash differs: \`make lock\` writes the index's hashes into the list;
    where the version is the same as before, find out why its file changed first"
}

# build_numpy REQUIREMENTS: prints the path of a wheel without OpenBLAS, which alone takes 28 MB. harmzone multiplies
# no matrices in numpy, which has slower code of its own for it. The wheel is kept: building takes 5 to 10 minutes.
build_numpy() {
    local requirements=$1 options kept building
    options=(-Dblas=none -Dlapack=none -Dcpu-dispatch=none -Doptimization=s)
    kept="${XDG_CACHE_HOME:-$HOME/.cache}/harmzone/wheels/$(
        { cat "$requirements" && echo "${options[@]}" && .venv-bundle/bin/python -VV && c++ --version; } | sha256sum | cut -c 1-16
    )"
    if ! compgen -G "$kept/*.whl" >/dev/null; then
        say "building numpy without OpenBLAS into $kept (5 to 10 minutes)"
        building=$(mktemp -d)
        # In one build folder; else pip compiles once for the metadata and again for the wheel. The settings stand in the
        # list, since pip does not apply those of its command line to what a list names.
        sed "s|^numpy==.*|& --config-settings=build-dir=$building/build ${options[*]/#/--config-settings=setup-args=}|" \
            "$requirements" >"$building/requirements.txt"
        PATH="$PWD/.venv-bundle/bin:$PATH" .venv-bundle/bin/python -m pip wheel --disable-pip-version-check --quiet \
            --no-deps --no-cache-dir --no-build-isolation --no-binary :all: --require-hashes \
            -r "$building/requirements.txt" -w "$building/wheels" >&2 || fail "numpy cannot be built; see above"
        compgen -G "$building/wheels/*.whl" >/dev/null || fail "pip left no wheel of numpy: $building/wheels"
        rm -rf "$kept"
        mkdir -p "$(dirname "$kept")"
        mv "$building/wheels" "$kept"
        rm -rf "$building"
    fi
    echo "$kept"/*.whl
}

# install_cuda VENV: PyTorch's wheel is linked with CUDA's libraries, although it runs on the CPU here.
install_cuda() {
    "$1/bin/python" -c 'import torch' 2>/dev/null || install_pinned "$1" tests/golden/requirements-cuda.txt
}

# Can MuJoCo draw without a window?
renders() {
    MUJOCO_GL=egl .venv/bin/python - >/dev/null 2>&1 <<'PYTHON'
import mujoco
context = mujoco.GLContext(16, 16)
context.make_current()
context.free()
PYTHON
}

has_browser() {
    [ -n "${CHROMIUM:-}" ] || command -v chromium || command -v chromium-browser || command -v google-chrome
} >/dev/null

case "${1:-}" in
product)
    command -v cargo >/dev/null || fail "cargo is missing. Install Rust 1.95 or newer: https://rustup.rs"
    command -v cc >/dev/null || system_packages "a C compiler and linker" build-essential
    make_venv .venv requirements.txt
    if ! renders; then
        system_packages "off-screen OpenGL (EGL)" libegl1 libegl-mesa0 libgl1-mesa-dri libgl1 libopengl0
        renders || fail "MuJoCo cannot render through EGL; this shows why:
    MUJOCO_GL=egl .venv/bin/python -c 'import mujoco; mujoco.GLContext(16, 16)'"
    fi
    touch .venv/.ready
    say "ready: $(.venv/bin/python --version), MuJoCo $(.venv/bin/python -c 'import mujoco; print(mujoco.__version__)')"
    ;;
test)
    make_venv .venv-test requirements-test.txt
    # A browser is no must: without one the report's test skips its browser part, and says so.
    if ! has_browser && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        (system_packages "Chromium, in which the report is tested," chromium) || true
    fi
    has_browser || say "NO BROWSER: the report will not be tested in one. On Debian: apt-get install chromium"
    touch .venv-test/.ready
    ;;
golden)
    make_venv .venv-golden tests/golden/requirements.txt
    install_cuda .venv-golden
    touch .venv-golden/.ready
    ;;
logs)
    make_venv .venv-logs tests/import/requirements.txt
    touch .venv-logs/.ready
    ;;
mmdet3d)
    make_venv .venv-mmdet3d tests/import/requirements-mmdet3d.txt
    install_cuda .venv-mmdet3d
    touch .venv-mmdet3d/.ready
    ;;
wheel)
    make_venv .venv-wheel requirements-wheel.txt
    touch .venv-wheel/.ready
    ;;
supply)
    make_venv .venv-supply requirements-supply.txt
    touch .venv-supply/.ready
    ;;
bundle)
    command -v c++ >/dev/null || system_packages "a C++ compiler" build-essential
    PYTHON="$PWD/.venv/bin/python" make_venv .venv-bundle requirements-bundle.txt
    numpy=$(build_numpy requirements-bundle-source.txt) || exit 1
    .venv-bundle/bin/python -m pip install --disable-pip-version-check --quiet --no-deps --no-index --force-reinstall "$numpy"
    touch .venv-bundle/.ready
    ;;
*) fail "usage: scripts/setup.sh product|test|golden|logs|mmdet3d|bundle|wheel|supply" ;;
esac
