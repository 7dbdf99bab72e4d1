"""Numbers over time in runs of the command: the law of free fall, the same bytes after stops and on two processes, and bad curves."""

import json
import os
import shutil
import subprocess

import h5py
import numpy as np
import pytest

from farm import BAD_SCENE, DRAPERY, assert_same, results
from howto import said
from test_mpi import AS_ROOT, MORE_THAN_CORES

SCENE = """drapery = 1
[shot]
name = "curves"
fps = "24"
frames = "1-9"
[output]
format = ["abc", "h5"]
[gravity]
acceleration = [[2, [0, 0, 0]], [6, [0, -8, 0]]]
[self_repulsion]
friction = [[1, 0.4], [9, 0.1]]
[self_collision]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
friction = [[3, 0.5], [7, 0]]
thickness = "3 mm"
[[garment]]
name = "sheet"
density = 0.2
thickness = "2 mm"
panel = { resolution = 16, side = 0.5, aspect = 1, center = [0, 0.205, 0] }
[garment.stretch]
stiffness = [[1, "400 N/m"], [9, "60 N/m"]]
[garment.dihedral_bending]
stiffness = 1e-5
"""

ENVIRONMENT = {**os.environ, **AS_ROOT, **MORE_THAN_CORES, "OMPI_MCA_mpi_yield_when_idle": "1"}


@pytest.fixture(params=["semi_implicit", "tr_bdf2"])
def scene(request, tmp_path):
    path = tmp_path / "curves.toml"
    path.write_text(SCENE.replace("[gravity]", f'[solver]\nintegrator = "{request.param}"\n[gravity]'))
    return path


def test_runs_that_stop_and_runs_of_two_processes_have_the_same_bytes(scene, tmp_path):
    said("run", scene, "--out", tmp_path / "whole")
    whole = results(tmp_path / "whole")
    for last in (2, 5, 9):
        said("run", scene, "--out", tmp_path / "parts", "--frames", f"1-{last}", *([] if last == 2 else ["--resume-with-changes"]))
    caches = {name for name in whole if not name.startswith("frame_")}
    parts = results(tmp_path / "parts")
    assert all(parts[name] == whole[name] for name in caches)
    if shutil.which("mpirun"):
        line = ["mpirun", "-n", "2", DRAPERY, "run", scene, "--out", tmp_path / "two", "--threads", "1"]
        done = subprocess.run(list(map(str, line)), capture_output=True, text=True, env=ENVIRONMENT, stdin=subprocess.DEVNULL)
        assert done.returncode == 0, done.stderr
        assert_same(tmp_path / "two", whole)
    # The written-out scene runs to the same bytes.
    said("run", tmp_path / "whole" / "resolved.toml", "--out", tmp_path / "again")
    assert all(results(tmp_path / "again")[name] == whole[name] for name in caches)


def test_cloth_falls_with_the_gravity_of_each_frame(tmp_path):
    path = tmp_path / "fall.toml"
    path.write_text('drapery = 1\n[shot]\nframes = "1-9"\n[output]\nformat = ["h5"]\n[gravity]\nacceleration = [[2, [0, 0, 0]], [6, [0, -8, 0]]]\n'
                    '[[garment]]\nname = "sheet"\ndensity = 0.2\npanel = { resolution = 4, side = 0.5, aspect = 1, center = [0, 1, 0] }\n')
    said("run", path, "--out", tmp_path / "out")
    [cache] = (tmp_path / "out").glob("*.h5")
    with h5py.File(cache) as file:
        heights = file["positions"][:, :, 1].mean(axis=1)
    dt, v, y, expected = 1 / 24, 0.0, 1.0, [1.0]
    for frame in range(2, 10):
        g = np.interp(frame, [2, 6], [0, 8])
        y, v = y - v * dt - g * dt * dt / 2, v + g * dt
        expected.append(y)
    assert np.allclose(heights, expected, rtol=0, atol=1e-6), heights - expected


def test_the_plan_lists_the_curves(scene):
    text, listed = said("plan", scene), json.loads(said("plan", scene, "--json"))["curves"]
    assert "garment.sheet.stretch.stiffness: 400 at 1, 60 at 9" in text
    assert listed["body.ball.friction"] == [[3, 0.5], [7, 0]] and listed["gravity.acceleration"] == [[2, [0, 0, 0]], [6, [0, -8, 0]]]


@pytest.mark.parametrize(("old", "new", "message"), [
    ("[[3, 0.5], [7, 0]]", "[[3, 0.5], [3, 0]]", "frames of `friction` have to increase"),
    ("[[3, 0.5], [7, 0]]", "[[-9, 0.5], [-3, 0]]", "ends at frame -3, before the first frame"),
    ("[[3, 0.5], [7, 0]]", "[[3, nan]]", "at frame 3"),
    ('[[1, "400 N/m"], [9, "60 N/m"]]', '[[1, "400 N"], [9, "60 N/m"]]', "at frame 1"),
])  # fmt: skip
def test_bad_curves_are_named(old, new, message, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(SCENE.replace(old, new))
    text = said("check", path, code=BAD_SCENE)
    assert message in text and "bad.toml:" in text, text
