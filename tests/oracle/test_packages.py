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


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    missing = [name for name in ("mmdebstrap", "buildah") if not shutil.which(name)]
    if os.geteuid() != 0 or missing:
        pytest.skip(f"not root, or not installed: {', '.join(missing)}")
    with image.Images(tmp_path_factory.mktemp("images")) as images:
        yield images


def test_an_archive_makes_its_first_cache_on_a_bare_debian(images, report_figure):
    archives = sorted(DIST.glob("drapery-[0-9]*.tar.gz"))
    if not archives:
        pytest.skip(f"no archive in {DIST}: `make dist`")
    images.make_base("debian:bookworm-slim")
    root = images.container("debian:bookworm-slim")
    shutil.copy(archives[0], root.folder)
    page = (ROOT / "docs" / "start" / "install.md").read_text()
    lines = re.search(r"## Archive\n\n```sh\n(.*?)```", page, re.DOTALL)[1]
    began = time.monotonic()
    root.call("bash", "-ec", lines)
    seconds = time.monotonic() - began
    [cache] = root.folder.glob("drapery-*/out/sheet.abc")
    assert cache.stat().st_size > 10_000
    report_figure(f"{seconds:.1f} s from the archive to the first cache, 24 frames of a sheet")
    said = root.call("bash", "-ec", "drapery-*/bin/drapery verify drapery-*/out/sheet.abc")
    assert "all rules are met" in said
    assert seconds < 60


@pytest.fixture(scope="module")
def built(images):
    """The image; its commands are compiled anew, which takes ten minutes."""
    images.build(ROOT, "drapery")
    return "drapery"


def test_the_image_runs_alone_and_on_ranks_as_any_user(images, built):
    begin, arguments = images.command(built)
    root = images.container(built)
    assert root.call("pwd") == "/shot" and begin == ["drapery"]
    assert "Usage: drapery" in root.call(*begin, *arguments)
    (root.folder / "shot").chmod(0o777)
    shot = ["run", SCENE, "--frames", "1001-1012", "--set", "resolution=15"]
    root.call(*begin, *shot, "--out", "alone", user=NOBODY)
    root.call("mpirun", "-n", 2, "drapery", *shot, "--out", "ranks", user=NOBODY)
    for name in ("sheet.abc", "sheet.h5"):
        alone, ranks = ((root.folder / "shot" / out / name).read_bytes() for out in ("alone", "ranks"))
        assert alone == ranks, name
    assert '"ranks": 2' in (root.folder / "shot/ranks/manifest.json").read_text()
    assert "all rules are met" in root.call(*begin, "verify", "alone/sheet.abc", user=NOBODY)
    # Nothing to compile with is left.
    assert not list(root.folder.glob("usr/bin/*gcc*")) and not (root.folder / "drapery").exists()
