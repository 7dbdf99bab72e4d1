"""Packages where nothing else is installed: the archive of `make dist` on Debian's smallest system, and the image of the Dockerfile."""

import os
import re
import shutil
import time
from pathlib import Path

import pytest

import image
from judges import ROOT

DIST = Path(os.environ.get("DRAPERY", ROOT / "target" / "release" / "drapery")).parents[1] / "dist"
SCENE = "/usr/local/share/drapery/scenes/hanging_sheet.toml"
# A user of no name, as with `docker run --user`.
NOBODY = "4711:4711"

pytestmark = pytest.mark.full


@pytest.fixture(scope="module", autouse=True)
def can_make_roots():
    if os.geteuid() != 0 or not shutil.which("mmdebstrap"):
        pytest.skip("not root, or mmdebstrap is not installed")


def test_an_archive_makes_its_first_cache_on_a_bare_debian(tmp_path, report_figure):
    archives = sorted(DIST.glob("drapery-[0-9]*.tar.gz"))
    if not archives:
        pytest.skip(f"no archive in {DIST}: `make dist`")
    root = image.debian(tmp_path / "root", "bookworm")
    shutil.copy(archives[0], root.folder / "root")
    page = (ROOT / "docs" / "start" / "install.md").read_text()
    lines = re.search(r"## Archive\n\n```sh\n(.*?)```", page, re.DOTALL)[1]
    root.work = "/root"
    began = time.monotonic()
    root.call("bash", "-ec", lines)
    seconds = time.monotonic() - began
    assert (root.folder / "root/out/sheet.abc").stat().st_size > 10_000
    report_figure(f"{seconds:.1f} s from the archive to the first cache, 24 frames of a sheet")
    said = root.call("bash", "-ec", "drapery-*/bin/drapery verify out/sheet.abc")
    assert "all rules are met" in said
    assert seconds < 60


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The image; its commands are compiled anew, which takes ten minutes."""
    return image.Build(ROOT, tmp_path_factory.mktemp("image")).root


def test_the_image_runs_alone_and_on_ranks_as_any_user(built):
    check_image(built)


def check_image(root):
    assert root.work == "/shot" and root.entry == ["drapery"]
    assert "Usage: drapery" in root.call(*root.entry, *root.arguments)
    (root.folder / "shot").chmod(0o777)
    shot = ["run", SCENE, "--frames", "1001-1012", "--set", "resolution=15"]
    root.call(*root.entry, *shot, "--out", "alone", user=NOBODY)
    root.call("mpirun", "-n", 2, "drapery", *shot, "--out", "ranks", user=NOBODY)
    for name in ("sheet.abc", "sheet.h5"):
        alone, ranks = ((root.folder / "shot" / out / name).read_bytes() for out in ("alone", "ranks"))
        assert alone == ranks, name
    assert '"ranks": 2' in (root.folder / "shot/ranks/manifest.json").read_text()
    assert "all rules are met" in root.call(*root.entry, "verify", "alone/sheet.abc", user=NOBODY)
    # Nothing to compile with is left.
    assert not list(root.folder.glob("usr/bin/*gcc*")) and not (root.folder / "drapery").exists()
