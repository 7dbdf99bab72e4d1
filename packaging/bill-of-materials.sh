#!/bin/bash
# Writes the bill of materials (CycloneDX 1.5) of a package of the workspace: packaging/bill-of-materials.sh CARGO_CYCLONEDX FOLDER FEATURES FILE.
# Called by dist.sh.
set -euo pipefail
cd "$(dirname "$0")/.."

cyclonedx=$1 member=$2 features=$3 file=$4
# The tool writes beside every manifest of a workspace; so it gets a copy.
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
git ls-files -z | xargs -0 cp --parents --no-dereference --target-directory="$copy"
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct) "$cyclonedx" cyclonedx --quiet --format json --spec-version 1.5 --no-build-deps \
    --target x86_64-unknown-linux-gnu --manifest-path "$copy/$member/Cargo.toml" --features "$features" --override-filename bill
# The crate that brings the HDF5 library has it as sources.
hdf5=$(cargo metadata --format-version 1 --locked --features "$features" --manifest-path "$copy/$member/Cargo.toml" |
    python3 -c 'import json, sys; print(next(p["manifest_path"] for p in json.load(sys.stdin)["packages"] if p["name"] == "hdf5-metno-src"))')
python3 packaging/bill_of_materials.py "$copy" "$copy/$member/bill.json" "$(dirname "$hdf5")" >"$file"
