"""A cache can be opened at any moment: while it is written, and after the run was killed."""

import random
import signal
import subprocess
import time

import h5py
import numpy as np
import pytest

from farm import holds_folder, reaches
from judges import hdf5, official

SCENE = "sample_assets/scenes/hanging_sheet.toml"
FIRST = 1001
FRAMES = f"{FIRST}-1048"
RESOLUTION = 28
KILLS = 6


@pytest.fixture(scope="module")
def whole(run_scene):
    """Name of the cache of the run that nobody disturbs, and what is in it."""
    out = run_scene(SCENE, FRAMES, resolution=RESOLUTION)
    (path,) = out.glob("*.h5")
    return path.name, hdf5(path)


def assert_begins_like(part, whole):
    frames = len(part["positions"])
    for name in ("positions", "velocities"):
        np.testing.assert_array_equal(part[name], whole[name][:frames])
    # Alembic stores the first time and the period.
    np.testing.assert_allclose(part["times"], whole["times"][:frames], rtol=1e-14)
    return frames


def test_after_a_kill_every_committed_frame_can_be_read(whole, drapery_command, tmp_path, report_figure):
    name, expected = whole
    moments = random.Random(2)
    found = []
    for number in range(KILLS):
        out = tmp_path / str(number)
        run = subprocess.Popen(drapery_command(SCENE, FRAMES, out, resolution=RESOLUTION), stdin=subprocess.DEVNULL,
                               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        # Before the first frame, then in each fifth of the run.
        if number == 0:
            holds_folder(out, run)
        else:
            reaches(out, run, FIRST + int(len(expected["times"]) * (number - 1 + moments.random()) / (KILLS - 1)) - 1)
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
    name, expected = whole
    run = subprocess.Popen(drapery_command(SCENE, FRAMES, tmp_path, resolution=RESOLUTION), stdin=subprocess.DEVNULL,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seen, is_held = set(), False
    cache = tmp_path / name
    try:
        while run.poll() is None:
            # Every other look is at a run that stands still, so that it cannot be over before the reader is on the machine's
            # processor again.
            is_held = not is_held
            run.send_signal(signal.SIGSTOP if is_held else signal.SIGCONT)
            if cache.exists() and h5py.is_hdf5(cache):
                seen.add(assert_begins_like(hdf5(cache), expected))
            if cache.with_suffix(".abc").exists():
                seen.add(assert_begins_like(official(cache.with_suffix(".abc")), expected))
            time.sleep(0.02)
    finally:
        run.kill()
    assert run.returncode == 0
    assert any(0 < frames < len(expected["times"]) for frames in seen), f"nothing was seen in between: {seen}"
