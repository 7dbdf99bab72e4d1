"""Dumps of the cloth after lines of a step, read by h5py: the paper's equations hold between them, on any number of ranks."""

import subprocess

import h5py
import numpy as np
import pytest

from farm import DRAPERY, PATIENCE
from test_mpi_runs import ENVIRONMENT, pytestmark as needs_mpi
from judges import ROOT

SCENE = ROOT / "sample_assets" / "scenes" / "spinning_ball.toml"
LINES = ["A", "B.1", "B.2", "B.3", "B.4", "B.5", "B.6", "B.7", "B.8", "C"]


def dump(out, points, *options, ranks=1, code=0):
    command = [DRAPERY, "run", str(SCENE), "--out", str(out), "--dump", points, "--set", "resolution=30", *options]
    if ranks > 1:
        command = ["mpirun", "-n", str(ranks), *command]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL,
                          timeout=PATIENCE)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def read(out, frame, step, line):
    with h5py.File(out / "dump" / f"frame_{frame:05}.step_{step:06}.{line}.h5") as file:
        (garment,) = file.values()
        return dict(file.attrs), {name: values[:] for name, values in garment.items()}


def files(out):
    return {path.name: path.read_bytes() for path in sorted((out / "dump").iterdir())}


def test_the_papers_equations_hold_between_the_dumps(tmp_path):
    said = dump(tmp_path / "out", ",".join(f"{line}@10" for line in LINES), "--frames", "0-10", "--threads", "2")
    names = files(tmp_path / "out")
    assert f"{len(names)} files in" in said
    steps = sorted(int(name.split("step_")[1][:6]) for name in names if name.endswith(".B.4.h5"))
    assert steps == list(range(1, len(steps) + 1)) and len(steps) > 1
    corrected = 0
    for step in steps:
        lines = {line: read(tmp_path / "out", 10, step, line) for line in LINES if line not in "AC"}
        dt = lines["B.3"][0]["dt"]
        of = {line: quantities for line, (_, quantities) in lines.items()}
        np.testing.assert_allclose(of["B.3"]["x_new"], of["B.2"]["x"] + dt * of["B.2"]["v_half"], rtol=0, atol=1e-15)
        np.testing.assert_allclose(of["B.6"]["v"], 2 * of["B.5"]["v_half"] - of["B.4"]["v_star"], rtol=0, atol=1e-13)
        np.testing.assert_array_equal(of["B.8"]["x"], of["B.4"]["x_new"])
        corrected += np.count_nonzero(of["B.4"]["x_new"] != of["B.3"]["x_new"])
    assert corrected > 0, "the cloth lies on the ball"
    # After the last step the caches have what C has left.
    _, last = read(tmp_path / "out", 10, steps[-1], "C")
    with h5py.File(next((tmp_path / "out").glob("*.h5"))) as cache:
        stored = cache["positions"][-1] * cache.attrs["metres_per_unit"]
    np.testing.assert_allclose(last["x"], stored, rtol=0, atol=1e-6)


@pytest.mark.parametrize("how", ["threads", "ranks", "a stop"])
def test_dumps_are_the_same_bytes_everywhere_and_change_no_cache(how, tmp_path):
    if how == "ranks" and any(mark.args[0] for mark in needs_mpi):
        pytest.skip("no MPI")
    points = "A@4,B.4@4,B.8@4.2,C@4"
    dump(tmp_path / "one", points, "--frames", "0-4", "--threads", "1")
    again = tmp_path / "again"
    if how == "a stop":
        dump(again, points, "--frames", "0-4", "--threads", "1", "--max-wall", "0.001s", code=75)
        dump(again, points, "--frames", "0-4", "--threads", "3")
    else:
        options = {"threads": ("--threads", "4"), "ranks": ("--threads", "1")}[how]
        dump(again, points, "--frames", "0-4", *options, ranks=3 if how == "ranks" else 1)
    assert files(again) == files(tmp_path / "one")
    plain = [DRAPERY, "run", str(SCENE), "--out", str(tmp_path / "plain"), "--frames", "0-4", "--set", "resolution=30"]
    assert subprocess.run(plain, capture_output=True, timeout=PATIENCE).returncode == 0
    for cache in sorted(path.name for path in (tmp_path / "plain").glob("*.[ah][b5]*")):
        assert (tmp_path / "plain" / cache).read_bytes() == (again / cache).read_bytes(), cache


@pytest.mark.parametrize("point, message", [("B.9", "there is no line"), ("B.4@x", "is neither a frame nor"), ("B.4@0", "frames 1-4")])
def test_what_cannot_be_dumped_is_refused_before_anything_is_written(point, message, tmp_path):
    said = dump(tmp_path / "out", point, "--frames", "0-4", code=2)
    assert message in said
    assert not (tmp_path / "out").exists()
