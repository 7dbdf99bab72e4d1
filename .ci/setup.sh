#!/bin/bash
# Installs what the commands of the README need: Debian packages, then the Python environment of the outside judges.
# Run again it only looks, which takes a fraction of a second. Arguments: more Debian packages.
set -euo pipefail
cd "$(dirname "$0")/.."

command -v cargo >/dev/null || {
    echo "setup: cargo is missing; install Rust from https://rustup.rs and run the command again" >&2
    exit 1
}

# The build (C compiler for zstd and the like, C++ for libFuzzer, HDF5, MPI and the library that reads its headers),
# mpirun, networks that a test can cut, the counter of instructions, a Blender with a window and a screen for it without one, a browser
# for the book, then what Blender's module links to even when it draws no window.
packages=(gcc g++ libc6-dev pkg-config libhdf5-dev libopenmpi-dev libclang-dev openmpi-bin iproute2 valgrind blender xvfb xauth chromium
    libgl1 libice6 libsm6 libx11-6 libxext6 libxfixes3 libxi6 libxkbcommon0 libxrender1 "$@")
# What fetches the library of the page of `drapery view`; it may come from elsewhere than Debian.
command -v npm >/dev/null || packages+=(npm)

# Any python3.11 that can make an environment will do, Debian's own or another.
python=""
for candidate in python3.11 /usr/bin/python3.11 python3; do
    if "$candidate" -c 'import sys, ensurepip, venv; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
        python=$candidate
        break
    fi
done
[ -n "$python" ] || packages+=(python3.11 python3.11-venv)

if command -v dpkg-query >/dev/null; then
    missing=()
    for package in "${packages[@]}"; do
        dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null | grep -q '^installed' || missing+=("$package")
    done
    if [ ${#missing[@]} -gt 0 ]; then
        as_root=()
        if [ "$(id -u)" -ne 0 ]; then
            if ! sudo -n true 2>/dev/null; then
                echo "setup: these Debian packages are missing; install them and run the command again:" >&2
                echo "    sudo apt-get install --no-install-recommends ${missing[*]}" >&2
                exit 1
            fi
            as_root=(sudo -n)
        fi
        echo "setup: installing Debian packages: ${missing[*]}"
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq
        "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends "${missing[@]}" </dev/null >/dev/null
    fi
    [ -n "$python" ] || python=/usr/bin/python3.11
else
    echo "setup: no Debian here; these packages, or what they are called on this system, have to be installed:"
    echo "    ${packages[*]}"
fi
[ -n "$python" ] || {
    echo "setup: Python 3.11 is missing (Blender's module accepts no other); install it and run the command again" >&2
    exit 1
}

analysis/viewer/library/build.sh

requirements=tests/oracle/requirements.txt
if ! cmp -s "$requirements" .venv/installed.txt; then
    echo "setup: installing the Python packages of $requirements into .venv (1.5 GB on disk)"
    "$python" -m venv .venv
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --requirement "$requirements"
    cp "$requirements" .venv/installed.txt
fi
