#!/bin/sh
# Installs header, libraries, pkg-config file and CMake package: plugins/capi/install.sh FOLDER_OF_LIBRARIES PREFIX [hdf5-inside]
# The last word is for libraries that were built with the feature static-hdf5: programs are then not linked to the system's.
# PREFIX may be moved afterwards.
set -eu
[ $# -eq 2 ] || [ "$#${3:-}" = 3hdf5-inside ] || {
    echo "usage: $0 FOLDER_OF_LIBRARIES PREFIX [hdf5-inside] (after: cargo build --release --package drapery-capi)" >&2
    exit 2
}
here=$(dirname "$0")
libraries=$1
prefix=$(mkdir -p "$2" && cd "$2" && pwd)
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -n 1)
mkdir -p "$prefix/include" "$prefix/lib/pkgconfig" "$prefix/lib/cmake/drapery_c"
cp "$here/include/drapery.h" "$prefix/include/"
cp "$libraries/libdrapery_c.so" "$libraries/libdrapery_c.a" "$prefix/lib/"
sed -e "s|@version@|$version|" "$here/drapery_c.pc.in" >"$prefix/lib/pkgconfig/drapery_c.pc"
cp "$here/cmake/drapery_c-config.cmake" "$prefix/lib/cmake/drapery_c/"
sed -e "s|@version@|$version|" "$here/cmake/drapery_c-config-version.cmake.in" \
    >"$prefix/lib/cmake/drapery_c/drapery_c-config-version.cmake"

if [ $# -eq 3 ]; then
    sed -i '/^Requires.private: hdf5$/d' "$prefix/lib/pkgconfig/drapery_c.pc"
    sed -i -e '/find_library(DRAPERY_HDF5/d' -e 's|"${DRAPERY_HDF5};m|"m|' "$prefix/lib/cmake/drapery_c/drapery_c-config.cmake"
    if grep -ri hdf5 "$prefix/lib/pkgconfig" "$prefix/lib/cmake"; then
        echo "$0: these lines ask for an HDF5 library that is inside" >&2
        exit 1
    fi
fi
