"""Samples between frames, for motion blur: Alembic's own library, Pixar's and Blender find them where the scene asks for them."""

import shutil
import signal
import subprocess

import numpy as np
import pytest
from farm import BAD_SCENE, CANNOT_CREATE, DONE, DRAPERY, STOPPED, Moments, Shot, assert_same, holds_folder, results, stop
from judges import ask, hdf5, official

FPS = 24.0
FRAMES = "1001-1008"

# Cloth thrown over a ball that passes by, with a pre-roll of two frames.
SCENE = """
drapery = 1

[shot]
frames = "1001-1008"
preroll = {{ settle = 2 }}

[output]
format = ["abc", "h5", "usd"]
{output}

[gravity]

[self_repulsion]

[self_collision]

[[body]]
name = "ball"
shape = {{ sphere = {{ radius = 0.15 }} }}
path = [[0.0, [0, 0.8, 0.3]], [0.3, [0, 0.8, -0.4]]]
friction = 0.4

[[garment]]
name = "flag"
panel = {{ resolution = 16, side = 0.5, aspect = 1.2, center = [0, 1.0, 0] }}
material = "cotton_shirting"
velocity = [0.5, -1, 0]
"""
SAMPLES = "samples = 3\nshutter = [-0.25, 0.25]"


def scene(folder, output=SAMPLES):
    folder.mkdir(exist_ok=True)
    (folder / "scene.toml").write_text(SCENE.format(output=output))
    return Shot(folder / "scene.toml", FRAMES)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sub_frames")
    scene(folder).run(folder / "out")
    return folder / "out"


def everything(out):
    """Bytes of all caches, clips among them."""
    return results(out) | {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*.usd*"))
                           if "stale" not in path.parts}


def test_samples_stand_at_the_frames_and_where_the_shutter_opens_and_closes(shot):
    archive, cache = official(shot / "flag.abc"), hdf5(shot / "flag.h5")
    frames = np.arange(1001, 1009)
    times = np.sort(np.concatenate([frames, frames[:-1] + 0.25, frames[:-1] + 0.75])) / FPS
    np.testing.assert_allclose(archive["times"], times, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(archive["positions"][::3], cache["positions"])
    np.testing.assert_array_equal(archive["velocities"][::3], cache["velocities"])
    assert archive["velocities"].shape == archive["positions"].shape
    x = archive["positions"].astype(float)
    np.testing.assert_array_equal(archive["self_bounds"], np.stack([x.min(axis=1), x.max(axis=1)], axis=1))


def test_velocities_are_the_differences_of_samples_the_better_the_closer_they_are(shot):
    archive = official(shot / "flag.abc")
    x, v = archive["positions"].astype(float), archive["velocities"].astype(float)

    def error(reach, span):
        """Relative error of velocities from samples `reach` before and behind each inner frame, which are `span` frames apart."""
        at = np.arange(3, len(x) - 1, 3)
        seen = (x[at + reach] - x[at - reach]) * (FPS / span)
        return np.linalg.norm(seen - v[at]) / np.linalg.norm(v[at])

    # The ball's blows, in which velocities jump, keep it from being a sixteenth.
    assert error(1, 0.5) < 0.5 * error(3, 2.0) and error(1, 0.5) < 0.05


def test_pixars_library_finds_the_samples_of_alembic_at_their_time_codes(shot):
    archive, shown = official(shot / "flag.abc"), ask("official_usd.py", shot / "flag.usd")
    assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
    np.testing.assert_allclose(shown["samples"] / FPS, archive["times"], rtol=0, atol=1e-9)
    # The judge asks for frames and for the middles between them, where positions are linear between 0.25 and 0.75.
    np.testing.assert_array_equal(shown["positions"][::2], archive["positions"][::3])
    x = archive["positions"].astype(float)
    np.testing.assert_allclose(shown["positions"][1::2], 0.5 * (x[1::3] + x[2::3]), rtol=0, atol=1e-6)


def test_blender_shows_the_samples_between_frames(shot):
    shown = ask("blender_import.py", shot / "flag.abc", str(int(FPS)), "1003", "1003.25", "1004.75")
    archive = official(shot / "flag.abc")
    x, y, z = np.moveaxis(archive["positions"][[6, 7, 11]], 2, 0)
    np.testing.assert_allclose(shown["positions"], np.stack([x, -z, y], axis=2), atol=2e-6)


def test_bytes_are_the_same_after_stops_anywhere_and_on_other_threads(shot, tmp_path):
    run, expected = scene(tmp_path / "stopped"), everything(shot)
    moments = Moments("sub-frames", run, 3.0)
    stopped_within = 0
    for number in range(4):
        out = tmp_path / "stopped" / str(number)
        for threads in (1, 3):
            process = run.start(out, threads=threads)
            assert holds_folder(out, process)
            moments.wait(out, process)
            code, _ = stop(process, signal.SIGTERM)
            assert code in (DONE, STOPPED)
            stopped_within += code == STOPPED
            if code == DONE:
                break
        run.run(out)
        assert everything(out) == expected
    assert stopped_within > 0
    out = tmp_path / "stopped" / "longer"
    run.run(out, last=1004)
    run.run(out)
    assert_same(out, results(shot))


def test_a_converted_cache_keeps_the_samples_or_says_that_it_does_not(shot, tmp_path):
    def convert(source, result):
        done = subprocess.run([DRAPERY, "convert", shot / source, tmp_path / result], capture_output=True, text=True)
        assert done.returncode == 0, done
        return done.stderr

    archive = official(shot / "flag.abc")
    assert convert("flag.usd", "flag.abc") == ""
    again = official(tmp_path / "flag.abc")
    np.testing.assert_allclose(again["times"], archive["times"], rtol=0, atol=1e-9)
    for name in ("positions", "velocities", "self_bounds"):
        np.testing.assert_array_equal(again[name], archive[name])
    for source, result in (("flag.abc", "flag.usd"), ("flag.usd", "flag.usdc")):
        assert convert(source, result) == ""
        shown = ask("official_usd.py", tmp_path / result)
        assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
        np.testing.assert_allclose(shown["samples"] / FPS, archive["times"], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(shown["positions"][::2], archive["positions"][::3])
    said = convert("flag.abc", "flag.h5")
    assert "14 samples between frames are left out: the format holds whole frames" in said, said
    np.testing.assert_array_equal(hdf5(tmp_path / "flag.h5")["positions"], archive["positions"][::3])


def test_a_sample_that_has_changed_on_the_disk_is_noticed(shot, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(shot, out)
    # The second sample behind frame 1003 (0-based 8 of all): one bit of one coordinate.
    stored = official(shot / "flag.abc")["positions"][8].astype("<f4").tobytes()
    (clips,) = (out / "flag.clips").iterdir()
    for path in (clips / "1003_2.usdc", out / "flag.abc"):
        good = path.read_bytes()
        place = good.index(stored) + 100
        path.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
        said = subprocess.run([DRAPERY, "verify", "--record", out], capture_output=True, text=True)
        assert said.returncode == 82 and "frame 1003: sample 2 after it: the positions do not match" in said.stderr, said
        path.write_bytes(good)
    assert subprocess.run([DRAPERY, "verify", "--record", out], capture_output=True).returncode == 0
    # A run that goes on notices too, and goes back.
    run = scene(tmp_path)
    run.run(out, "--overwrite", last=1005)
    (clips,) = (out / "flag.clips").iterdir()
    good = (clips / "1003_2.usdc").read_bytes()
    place = good.index(stored) + 100
    (clips / "1003_2.usdc").write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
    said = run.run(out)
    assert "frame 1003: sample 2 after it" in said, said
    assert everything(out) == everything(shot)


def test_a_clip_between_frames_that_is_damaged_is_found_without_a_record(shot, tmp_path):
    shutil.copytree(shot, tmp_path / "out")
    cache = tmp_path / "out" / "flag.usd"
    said = subprocess.run([DRAPERY, "verify", cache], capture_output=True, text=True)
    assert said.returncode == 0 and "8 samples and 14 between them; frame 1001 is time code 1001" in said.stdout, said
    (clips,) = cache.with_suffix(".clips").iterdir()
    (clips / "1004_1.usdc").write_bytes((clips / "1004_1.usdc").read_bytes()[:-100])
    said = subprocess.run([DRAPERY, "verify", cache], capture_output=True, text=True)
    assert said.returncode == 82 and "frame 1004.25" in said.stderr, said


def test_a_shutter_that_is_written_with_its_default_is_the_same_run(shot, tmp_path):
    out = tmp_path / "out"
    scene(tmp_path, "samples = 3").run(out, last=1003)
    said = scene(tmp_path, SAMPLES + "\npreroll = false").run(out)
    assert "shutter" not in said and "preroll" not in said, said
    assert_same(out, results(shot))


def test_the_preroll_is_written_where_the_scene_asks_for_it(tmp_path):
    scene(tmp_path, "preroll = true").run(tmp_path / "out", last=1002)
    cache = hdf5(tmp_path / "out" / "flag.h5")
    np.testing.assert_array_equal(cache["frame_numbers"], np.arange(999, 1003))
    archive = official(tmp_path / "out" / "flag.abc")
    np.testing.assert_allclose(archive["times"], np.arange(999, 1003) / FPS, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(archive["positions"], cache["positions"])


@pytest.mark.parametrize("output", ["samples = 3\nshutter = [0.5, 0.5]", "samples = 3\nshutter = [-0.75, 0.75]",
                                    "shutter = [0, 0.5]", "samples = 0", "samples = 3\nshutter = [0]"])
def test_a_shutter_that_is_none_is_refused(output, tmp_path):
    said = scene(tmp_path, output).run(tmp_path / "out", code=BAD_SCENE)
    assert "shutter" in said or "samples" in said, said
    assert not (tmp_path / "out").exists()


def test_other_samples_make_another_run(shot, tmp_path):
    scene(tmp_path).run(tmp_path / "out", last=1003)
    said = scene(tmp_path, "samples = 5").run(tmp_path / "out", code=CANNOT_CREATE)
    assert "output.samples" in said, said


def with_formats(folder, formats):
    run = scene(folder)
    text = (folder / "scene.toml").read_text()
    (folder / "scene.toml").write_text(text.replace('["abc", "h5", "usd"]', formats))
    return run


def test_a_format_that_is_added_takes_the_samples_over_from_one_that_has_them(shot, tmp_path):
    out = tmp_path / "out"
    with_formats(tmp_path, '["h5", "abc"]').run(out, last=1003)
    with_formats(tmp_path, '["abc", "h5", "usd"]').run(out)
    for name in ("flag.abc", "flag.usd"):
        said = subprocess.run([DRAPERY, "diff", shot / name, out / name], capture_output=True, text=True)
        assert said.returncode == 0 and "equal" in said.stdout, said
    # Of whole frames there is nothing to take over.
    out = tmp_path / "whole"
    with_formats(tmp_path, '["h5"]').run(out, last=1003)
    said = with_formats(tmp_path, '["h5", "abc"]').run(out, code=65)
    assert "flag.h5" in said and "holds whole frames, and no other cache" in said and "1001.25" in said, said


def test_samples_between_frames_are_compared(shot, tmp_path):
    cache = tmp_path / "flag.abc"
    shutil.copy(shot / "flag.abc", cache)
    stored = official(cache)["positions"][8].astype("<f4")
    good = cache.read_bytes()
    moved = stored.copy()
    moved[5, 0] += 5.0
    assert good.count(stored.tobytes()) == 1
    cache.write_bytes(good.replace(stored.tobytes(), moved.tobytes()))
    said = subprocess.run([DRAPERY, "diff", shot / "flag.abc", cache], capture_output=True, text=True)
    assert said.returncode == 1 and "largest difference: vertex 5" in said.stdout and "frame 1003.75, 5.000e0 m" in said.stdout, said
    # What a format cannot hold is no difference; what a cache lacks is.
    whole = subprocess.run([DRAPERY, "diff", shot / "flag.abc", shot / "flag.h5"], capture_output=True, text=True)
    assert whole.returncode == 0, whole
    shorter = tmp_path / "frames.abc"
    assert subprocess.run([DRAPERY, "convert", shot / "flag.h5", shorter], capture_output=True).returncode == 0
    lacks = subprocess.run([DRAPERY, "diff", shot / "flag.abc", shorter], capture_output=True, text=True)
    assert lacks.returncode == 1 and "only the first has 14 samples between frames, the first at frame 1001.25" in lacks.stdout
