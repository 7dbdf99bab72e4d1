#!/bin/bash
# Tests the wheel of plugins/python as a user has it: installed, away from the sources. Called by `make test`.
set -euo pipefail
cd "$(dirname "$0")/.."

packaging/install-wheel.sh
project=$PWD
cd "$(realpath -m "${CARGO_TARGET_DIR:-target}")/python"
venv/bin/python -m pytest "$project/plugins/python/tests" -c "$project/plugins/python/pyproject.toml" -q
