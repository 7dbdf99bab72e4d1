#!/usr/bin/env python3
"""Makes the zip that Blender installs by drag and drop: the add-on with the solver's wheel inside.

    plugins/blender/package.py FOLDER                    with the wheels drapery-*.whl in FOLDER, one for each platform
    plugins/blender/package.py --without-solver FOLDER   for places where everybody names a drapery executable in the preferences

The zip goes into FOLDER; its path is printed. The same input gives the same bytes. Called by `make dist`.
"""

import argparse
import re
import sys
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ADD_ON = HERE / "drapery_cloth"
# Tags of wheels, and what Blender calls these platforms.
PLATFORMS = {r"(many)?linux.*x86_64": "linux-x64", r"win_amd64": "windows-x64", r"macosx.*arm64": "macos-arm64",
             r"macosx.*x86_64": "macos-x64"}  # fmt: skip


class Unusable(Exception):
    """The wheel makes no zip; the text says why."""


def platform_of(wheel):
    """Returns Blender's name for the platform of a wheel. Raises `Unusable`."""
    match = re.fullmatch(r"drapery-([^-]+)-(cp3\d+)-(abi3|cp3\d+)-(.+)\.whl", wheel.name)
    if not match:
        raise Unusable(f"{wheel.name} is no wheel of the solver: drapery-VERSION-cp310-abi3-PLATFORM.whl is wanted")
    if match[3] != "abi3":
        raise Unusable(f"{wheel.name} is for one version of Python; Blender's differ, so a wheel for abi3 is wanted")
    with zipfile.ZipFile(wheel) as archive:
        if "drapery/__main__.py" not in archive.namelist():
            raise Unusable(f"{wheel.name} has no drapery/__main__.py, so `python -m drapery` would not run")
    for tag, platform in PLATFORMS.items():
        if re.fullmatch(tag, match[4]):
            return platform
    raise Unusable(f"{wheel.name} is for a platform that Blender does not run on: {match[4]}")


def manifest(wheels):
    """The manifest of the add-on with its wheels."""
    text = (ADD_ON / "blender_manifest.toml").read_text("utf-8")
    if not wheels:
        return text
    platforms = sorted({platform_of(wheel) for wheel in wheels})
    lines = ["platforms = [" + ", ".join(f'"{platform}"' for platform in platforms) + "]", "wheels = ["]
    lines += [f'  "./wheels/{wheel.name}",' for wheel in wheels]
    # Keys of the manifest itself stand before its tables.
    return text.replace("\n[permissions]", "\n" + "\n".join([*lines, "]"]) + "\n\n[permissions]")


def make(out, wheels):
    """Writes the zip and returns its path. Raises `Unusable`, `OSError`."""
    text = manifest(wheels)
    version = re.search(r'^version = "(.*)"', text, re.MULTILINE)[1]
    suffix = "-".join(sorted({platform_of(wheel) for wheel in wheels})) or "without-solver"
    files = {f"drapery_cloth/{path.name}": path.read_bytes() for path in ADD_ON.iterdir() if path.suffix == ".py"}
    files["drapery_cloth/blender_manifest.toml"] = text.encode()
    for licence in ("LICENSE-APACHE", "LICENSE-MIT"):
        files[f"drapery_cloth/{licence}"] = (HERE.parent.parent / licence).read_bytes()
    for wheel in wheels:
        files[f"drapery_cloth/wheels/{wheel.name}"] = wheel.read_bytes()
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"drapery_cloth-{version}-{suffix}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            # Wheels are compressed already.
            kind = zipfile.ZIP_STORED if name.endswith(".whl") else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name), files[name], kind)
    return path


def main():
    parser = argparse.ArgumentParser(description="Makes the zip of the Blender add-on")
    parser.add_argument("--without-solver", action="store_true")
    parser.add_argument("folder", type=Path, help="where the wheels of the solver are, and where the zip goes")
    options = parser.parse_args()
    wheels = [] if options.without_solver else sorted(options.folder.glob("*.whl"))
    if not wheels and not options.without_solver:
        sys.exit(f"package: {options.folder} holds no wheel of the solver; `make dist` builds it, or make a zip --without-solver")
    try:
        print(make(options.folder, wheels))
    except (Unusable, OSError) as error:
        sys.exit(f"package: {error}")


if __name__ == "__main__":
    main()
