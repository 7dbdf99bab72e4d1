#!/bin/bash
# Builds the wheel of plugins/python into a folder: packaging/python-wheel.sh FOLDER [FEATURE...]. With the feature static-hdf5 the HDF5
# library is inside; without, the machine has to have it. What builds it is installed beside the other builds.
set -euo pipefail
cd "$(dirname "$0")/.."

[ $# -ge 1 ] || {
    echo "usage: $0 FOLDER [FEATURE...]" >&2
    exit 2
}
out=$1
shift
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
venv=$target/python/venv
requirements=plugins/python/requirements.txt
if ! cmp -s "$requirements" "$venv/installed.txt"; then
    echo "python-wheel: installing the Python packages of $requirements into $venv"
    rm -rf "$venv"
    .venv/bin/python -m venv "$venv"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$requirements"
    cp "$requirements" "$venv/installed.txt"
fi

features=(usd "$@")
# For the HDF5 library, where it is built.
export CMAKE=$venv/bin/cmake
# A wheel with everything inside says which Linux it runs on; one that needs the system's library is for this machine.
check=skip
[[ " $* " == *" static-hdf5 "* ]] && check=check
rm -rf "$out"
CARGO_TARGET_DIR=$target "$venv/bin/maturin" build --quiet --release --locked --auditwheel "$check" --interpreter "$venv/bin/python" \
    --features "$(IFS=,; echo "${features[*]}")" --ignore-rust-version --manifest-path plugins/python/Cargo.toml --out "$out"
