"""A cache can be opened at any moment: while it is written, and after the run was killed."""

import random
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest

from judges import hdf5, official

SCENE = "sample_assets/scenes/hanging_sheet.toml"
FRAMES = "1001-1048"
RESOLUTION = 40
KILLS = 5


@pytest.fixture(scope="module")
def whole(run_scene):
    """The run that nobody disturbs, and how long it takes [s]."""
    start = time.monotonic()
    out = run_scene(SCENE, FRAMES, resolution=RESOLUTION)
    duration = time.monotonic() - start
    (path,) = out.glob("*.h5")
    return path.name, hdf5(path), duration


def assert_begins_like(part, whole):
    frames = len(part["positions"])
    for name in ("positions", "velocities"):
        np.testing.assert_array_equal(part[name], whole[name][:frames])
    # Alembic stores the first time and the period.
    np.testing.assert_allclose(part["times"], whole["times"][:frames], rtol=1e-14)
    return frames


def test_after_a_kill_every_committed_frame_can_be_read(whole, drapery_command, tmp_path, report_figure):
    name, expected, duration = whole
    moments = random.Random(2)
    found = []
    for number in range(KILLS):
        out = tmp_path / str(number)
        run = subprocess.Popen(drapery_command(SCENE, FRAMES, out, resolution=RESOLUTION), stdin=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        # One moment in each fifth of the run, so that early and late ones are among them.
        time.sleep(duration * (number + moments.random()) / KILLS)
        run.send_signal(signal.SIGKILL)
        run.wait()
        cache = out / name
        if not cache.exists() or not cache.with_suffix(".abc").exists():
            found.append(0)  # killed before the first frame; there is nothing under a final name
            continue
        frames = assert_begins_like(hdf5(cache), expected)
        archive = official(cache.with_suffix(".abc"))
        in_archive = assert_begins_like(archive, expected)
        # The two files are committed one after the other.
        assert abs(in_archive - frames) <= 1
        found.append(frames)
    report_figure(f"frames found after the kills: {found} of {len(expected['times'])}")
    assert sum(0 < frames < len(expected["times"]) for frames in found) >= 2, f"no kill came in between: {found}"


def test_both_caches_can_be_read_while_they_are_written(whole, drapery_command, tmp_path):
    name, expected, _ = whole
    run = subprocess.Popen(drapery_command(SCENE, FRAMES, tmp_path, resolution=RESOLUTION), stdin=subprocess.DEVNULL,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seen = set()
    cache = tmp_path / name
    try:
        while run.poll() is None:
            if cache.exists() and h5py.is_hdf5(cache):
                seen.add(assert_begins_like(hdf5(cache), expected))
            if cache.with_suffix(".abc").exists():
                seen.add(assert_begins_like(official(cache.with_suffix(".abc")), expected))
            time.sleep(0.02)
    finally:
        run.kill()
    assert run.returncode == 0
    assert any(0 < frames < len(expected["times"]) for frames in seen), f"nothing was seen in between: {seen}"
