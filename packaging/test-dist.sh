#!/bin/bash
# Tries what `make dist` has made, each part in an empty folder: the command in a root that holds nothing but the C library, where it
# runs the first scene of the tour and two frames of the demo; the package for C with programs of its own; the wheel in a new
# environment; the add-on by what lies in it; the bills of materials by their schema. Argument: the folder with the parts.
set -euo pipefail
project=$(cd "$(dirname "$0")/.." && pwd)
target=$(realpath -m "${CARGO_TARGET_DIR:-$project/target}")
dist=$(realpath "$1")
room=$(mktemp -d)
trap 'rm -rf "$room"' EXIT
cd "$room"

say() { printf 'test-dist: %s\n' "$*"; }
fail() {
    say "$*" >&2
    exit 1
}

# What a machine has to bring: the C library, its loader, and the compiler's runtime, which every Linux has.
brings='linux-vdso|/ld-linux|libc\.so|libm\.so|libgcc_s|libpthread|libdl|librt'
# alone FILE [OTHER]: whether a file needs nothing else, but what the pattern OTHER names.
alone() {
    local others
    others=$(ldd "$1" | grep -Ev "$brings${2:+|$2}" || true)
    [ -z "$others" ] || fail "$1 needs more than the C library: $others"
    say "$(basename "$1"): $(stat -c %s "$1" | numfmt --to=si)B, needs glibc $(objdump -T "$1" | grep -o 'GLIBC_[0-9.]*' | sort -Vu | tail -n 1 | cut -d_ -f2) or later"
}

(cd "$dist" && sha256sum --check --quiet SHA256SUMS) || fail "checksums are not those of the files"

say "bills of materials"
# By the schema of CycloneDX; and each crate whose licence is inside has its row in one of them.
"$project/.venv/bin/python" -m venv bills
bills/bin/python -m pip install --quiet --disable-pip-version-check 'cyclonedx-python-lib[json-validation]==11.12.0'
bills/bin/python "$project/packaging/check_bills.py" "$target/dist-parts/THIRD_PARTY.txt" "$dist"/*.cdx.json >log || fail "$(cat log)"

say "the command"
mkdir command
tar -xzf "$dist"/drapery-[0-9]*.tar.gz -C command --strip-components=1
alone command/bin/drapery
alone command/bin/drapery-assets
[ -s command/share/man/man1/drapery.1 ] && [ -s command/share/man/man1/drapery-run.1 ] || fail "man pages are missing"
[ -s command/share/bash-completion/completions/drapery.bash ] || fail "completions are missing"
grep -q 'HDF5' command/THIRD_PARTY.txt && grep -q 'three.js' command/THIRD_PARTY.txt || fail "licences are missing"
# A root of its own, where the system allows it.
mkdir -p root/tmp
cp -r command root/drapery
ldd command/bin/drapery | grep -o '/[^ ]*' | while read -r library; do
    mkdir -p "root$(dirname "$library")"
    cp -L "$library" "root$library"
done
inside=(chroot root)
[ "$(id -u)" -eq 0 ] || inside=(unshare --user --map-root-user chroot root)
try() { "${inside[@]}" "$@" >log 2>&1 || fail "in an empty root: $*: $(cat log)"; }
try /drapery/bin/drapery run /drapery/sample_assets/scenes/hanging_sheet.toml --frames 1001-1004 --set resolution=10 --out /out
sound() {
    try /drapery/bin/drapery verify "$1"
    grep -q 'all rules are met' log || fail "$1 is not sound: $(cat log)"
}
sound /out/sheet.abc
try /drapery/bin/drapery view /out --page /out/page.html
try /drapery/bin/drapery-assets mannequin --out /assets
try /drapery/bin/drapery run /drapery/sample_assets/scenes/dressed_mannequin.toml --frames 1001-1002 --set assets=/assets \
    --set 'output.format=["abc", "h5", "usd"]' --out /demo
sound /demo/skirt.abc
sound /demo/skirt.usd

say "the package for C"
mkdir c
tar -xzf "$dist"/drapery-c-*.tar.gz -C c --strip-components=1
alone c/lib/libdrapery_c.so
export PKG_CONFIG_PATH=$room/c/lib/pkgconfig
# shellcheck disable=SC2046 # words of the compiler
c++ -std=c++17 c/share/drapery_c/examples/live_node.cpp -o node $(pkg-config --cflags --libs drapery_c)
LD_LIBRARY_PATH=$room/c/lib ./node >log 2>&1 && grep -q 'the same bits' log || fail "the node does not run: $(cat log)"
# Both libraries by the CMake package, in a folder that the package has been moved to.
mv c moved
cat >CMakeLists.txt <<'END'
cmake_minimum_required(VERSION 3.20)
project(node CXX)
set(CMAKE_CXX_STANDARD 17)
find_package(drapery_c 0.1 REQUIRED)
foreach(kind shared static)
    add_executable(node_${kind} ${CMAKE_PREFIX_PATH}/share/drapery_c/examples/live_node.cpp)
    target_link_libraries(node_${kind} drapery_c::${kind})
endforeach()
END
cmake=$target/python/venv/bin/cmake
{ "$cmake" -S . -B nodes -DCMAKE_PREFIX_PATH="$room/moved" && "$cmake" --build nodes; } >log 2>&1 || fail "CMake: $(cat log)"
alone nodes/node_static 'libstdc\+\+'
for kind in shared static; do
    "nodes/node_$kind" >log 2>&1 && grep -q 'the same bits' log || fail "node_$kind does not run: $(cat log)"
done

say "the wheel"
"$project/.venv/bin/python" -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check "$dist"/*.whl
alone venv/lib/python3*/site-packages/drapery/_native.abi3.so
[ -s "$(echo venv/lib/python3*/site-packages/drapery/licences/THIRD_PARTY.txt)" ] || fail "licences are missing in the wheel"
(cd / && "$room/venv/bin/python" -m drapery run "$room/command/sample_assets/scenes/hanging_sheet.toml" --frames 1001-1004 --set resolution=10 \
    --out "$room/wheel_out" >"$room/log" 2>&1) || fail "the wheel does not run the first scene: $(cat log)"
cmp root/out/sheet.abc wheel_out/sheet.abc || fail "the wheel has other bytes than the command"

say "the add-on for Blender"
mkdir add_on
"$project/.venv/bin/python" -m zipfile -e "$dist"/drapery_cloth-*.zip add_on
wheel=$(basename "$dist"/*.whl)
cmp "$dist/$wheel" "add_on/drapery_cloth/wheels/$wheel" || fail "the add-on has another wheel inside"
grep -q "\./wheels/$wheel" add_on/drapery_cloth/blender_manifest.toml || fail "the add-on does not name its wheel"

say "all parts are complete"
