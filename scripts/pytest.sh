#!/usr/bin/env bash
# The tests of the Python side and of the scripts. Exit 5, "no test collected", is a failure only where test files exist.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ -z "$(find python -name 'test_*.py' -print -quit 2>/dev/null)" ]; then
    echo "no Python tests yet"
    exit 0
fi
MUJOCO_GL="${MUJOCO_GL:-egl}" PYTHONPATH=python:scripts:xtask/python exec .venv-test/bin/python -m pytest python scripts xtask/python
