#!/bin/bash
# Makes what is given away, with checksums and bills of materials: the command with its pages and sample character, the package for C, the
# wheel for Python, the add-on for Blender. HDF5 is inside everything, MPI in nothing. Called by `make dist`, with the folder that gets it.
set -euo pipefail
cd "$(dirname "$0")/.."

out=$(realpath -m "$1")
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
machine=$(uname -m)-linux
rm -rf "$out"
mkdir -p "$out"

# Packs a folder, in an order and with times that depend on nothing but the commit.
pack() {
    tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$(git log -1 --format=%ct)" -C "$target/dist-parts" -c "$1" |
        gzip -n9 >"$out/$1.tar.gz"
}

echo "dist: 1 of 6, licences and bills of materials of all that is inside"
about=$target/tools/bin/cargo-about
[ -x "$about" ] || cargo install --quiet --locked --root "$target/tools" --version 0.9.3 --features cli cargo-about
licences=$target/dist-parts/THIRD_PARTY.txt
inside=plugins/python/python/drapery/licences
rm -rf "$inside"
trap 'rm -rf "$inside"' EXIT
mkdir -p "$target/dist-parts"
"$about" generate --config packaging/licences.toml --manifest-path plugins/python/Cargo.toml --features usd,static-hdf5 --locked --fail \
    --output-file "$licences" packaging/licences.hbs
grep -q 'HDF5 (Hierarchical Data Format 5)' "$licences" || { echo "dist: the licence of HDF5 is missing" >&2; exit 1; }
# The library of the page of `drapery view` is no crate; its licence stands at its beginning.
{
    printf '\n================================================================================\n'
    sed -n '/^\/\*!$/,/^\*\/$/p' analysis/viewer/library/three.js | sed '1d;$d'
} >>"$licences"
grep -q 'three.js authors' "$licences" || { echo "dist: the licence of three.js is missing" >&2; exit 1; }
# The wheel carries them, and those of Drapery, in its package for as long as it is built.
mkdir -p "$inside"
cp LICENSE-MIT LICENSE-APACHE "$licences" "$inside/"

cyclonedx=$target/tools/bin/cargo-cyclonedx
[ -x "$cyclonedx" ] || cargo install --quiet --locked --root "$target/tools" --version 0.5.9 cargo-cyclonedx
for part in drapery:cli drapery-c:plugins/capi drapery-python:plugins/python; do
    packaging/bill-of-materials.sh "$cyclonedx" "${part#*:}" usd,static-hdf5 "$out/${part%:*}-$version.cdx.json"
done

echo "dist: 2 of 6, building the wheel, then the command and the libraries for C"
packaging/python-wheel.sh "$target/dist-parts/wheel" static-hdf5
# It has installed what builds HDF5.
export CMAKE=$target/python/venv/bin/cmake
# In a folder of their own: `target/release` stays what `make build` has put there. Crates are compiled where all are, together with
# the wheel's package, so that nothing is compiled twice; a Cargo before 1.91 does not know how, and compiles all of it once more.
built=$target/dist-build/release
static=(drapery/usd drapery/static-hdf5 drapery-capi/usd drapery-capi/static-hdf5 drapery-python/usd drapery-python/static-hdf5)
CARGO_TARGET_DIR=$target/dist-build CARGO_BUILD_BUILD_DIR=$target cargo build --quiet --release --locked --ignore-rust-version \
    --package drapery --package drapery-assets --package drapery-capi --package drapery-python \
    --features "$(IFS=,; echo "${static[*]}")"
# Of the crates of `make build`, since pages know nothing of features.
cargo build --quiet --release --locked --ignore-rust-version --workspace --features drapery/mpi,drapery/usd --example pages
"$target/release/examples/pages" "$target/dist-parts/pages"

echo "dist: 3 of 6, the command"
name=drapery-$version-$machine
part=$target/dist-parts/$name
rm -rf "$part"
mkdir -p "$part/bin"
cp "$built/drapery" "$built/drapery-assets" "$part/bin/"
strip "$part"/bin/*
cp -r "$target/dist-parts/pages/share" "$part/"
# Where the pages name them.
mkdir "$part/sample_assets"
cp -r sample_assets/scenes sample_assets/howto "$part/sample_assets/"
cp README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$licences" "$part/"
pack "$name"

echo "dist: 4 of 6, the package for C"
name=drapery-c-$version-$machine
part=$target/dist-parts/$name
rm -rf "$part"
plugins/capi/install.sh "$built" "$part" hdf5-inside
strip --strip-unneeded "$part/lib/libdrapery_c.so"
strip --strip-debug "$part/lib/libdrapery_c.a"
mkdir -p "$part/share/drapery_c"
cp -r plugins/capi/examples docs/reference/c_api.md LICENSE-MIT LICENSE-APACHE "$licences" "$part/share/drapery_c/"
pack "$name"

echo "dist: 5 of 6, the wheel"
cp "$target"/dist-parts/wheel/*.whl "$out/"

echo "dist: 6 of 6, the add-on for Blender, with the wheel inside"
.venv/bin/python plugins/blender/package.py "$out"

(cd "$out" && sha256sum -- * >SHA256SUMS)
ls -lh "$out"
