"""`verify --record` finds what somebody changed in an HDF5 cache, also where it is the same in all frames."""

import shutil
import subprocess

import h5py
import pytest

from conftest import program

SCENE = """
drapery = 1
[shot]
name = "sheet"
fps = "24"
frames = "1-3"
[gravity]
[[garment]]
name = "sheet"
panel = { resolution = 5, side = 1.0 }
material = "cotton_shirting"
[output]
format = ["h5"]
attributes = ["normals", "rest", "strain", "contact", "thickness"]
"""


def drapery(*arguments):
    line = [program("DRAPERY", "drapery"), *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    (folder / "scene.toml").write_text(SCENE)
    done = drapery("run", folder / "scene.toml", "--out", folder / "out")
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "out"


def test_a_cache_that_nobody_touched_is_what_was_written(run):
    done = drapery("verify", "--record", run)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("name", ["face_counts", "face_indices", "triangles", "rest", "thickness", "times"])
def test_a_changed_dataset_that_does_not_move_is_found(run, tmp_path, name):
    changed = tmp_path / "out"
    shutil.copytree(run, changed)
    with h5py.File(next(changed.rglob("sheet.h5")), "r+") as file:
        values = file[name]
        first = (0,) * values.ndim
        values[first] = values[first] + 1
    done = drapery("verify", "--record", changed)
    assert done.returncode != 0 and "are not what was written" in done.stdout + done.stderr, done.stdout + done.stderr
