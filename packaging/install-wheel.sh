#!/bin/bash
# Builds the wheel of plugins/python and installs it beside the other builds, in python/venv: as a user has it.
set -euo pipefail
cd "$(dirname "$0")/.."

folder=$(realpath -m "${CARGO_TARGET_DIR:-target}")/python
packaging/python-wheel.sh "$folder/wheels"
"$folder/venv/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$folder"/wheels/*.whl
