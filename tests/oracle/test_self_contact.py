"""No triangle of cloth crosses another in any stored frame, as libigl judges it."""

import json
import time

import numpy as np
import pytest

from body_depth import RELEASE_REACH, crossing_triangles
from crossings import Body, Cloth, body_crossings, crossing_pairs
from judges import hdf5

SAMPLES = "sample_assets/scenes"

# Frames within which cloth that a body has pinched is out of it again.
RESOLVED_WITHIN = 12


def assert_no_crossing(out, report_figure):
    """Judges every frame of a run."""
    cloth = Cloth.of_run(out)
    start = time.process_time()
    crossed = [(frame, pairs) for index, frame in enumerate(cloth.frames) if len(pairs := cloth.crossings(index))]
    judged = time.process_time() - start
    steps = [json.loads(line) for line in (out / "run.jsonl").read_text().splitlines()]
    seconds = sum(line.get("seconds", 0.0) for line in steps if "frame" in line)
    report_figure(
        f"{len(cloth.frames)} frames of {len(cloth.faces)} triangles in {seconds:.1f} s, judged in {judged:.1f} s; "
        f"{len(crossed)} frames with crossings"
    )
    if crossed:
        frame, pairs = crossed[0]
        pytest.fail(
            f"{len(crossed)} of {len(cloth.frames)} frames have crossings; the first is frame {frame} with "
            f"{len(pairs)} pairs, such as {cloth.name(pairs[0, 0])} with {cloth.name(pairs[0, 1])}"
        )
    return cloth


def assert_cloth_does_not_cross_the_body(cloth, body, report_figure):
    """Judges every frame; what crosses within reach of where the body crosses itself is counted apart, and so is what it
    leaves behind until the tangle is resolved."""
    outside, pinched, tail, last_pinched = {}, 0, 0, -np.inf
    for index, frame in enumerate(cloth.frames):
        found, excused = body_crossings(
            cloth.positions(index), cloth.faces, body.vertices(cloth.times[index]), body.faces
        )
        pinched += len(excused)
        last_pinched = frame if len(excused) else last_pinched
        if len(found) and frame - last_pinched <= RESOLVED_WITHIN:
            tail += 1
        elif len(found):
            outside[int(frame)] = [cloth.name(face) for face in found[:3]]
    report_figure(
        f"{len(outside)} frames in which cloth crosses the body; in all frames {pinched} cloth triangles cross it "
        f"within {1000 * RELEASE_REACH:.0f} mm of where it crosses itself; {tail} frames in which it still does after that"
    )
    assert not outside, outside


def two_patches(gap):
    """Two triangles, the tip of one `gap` above the other."""
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.25, 0.25, gap), (0.5, 0.25, 1), (0.25, 0.5, 1)]
    return np.array(points, float), np.array([(0, 1, 2), (3, 4, 5)], np.int64)


def test_the_judge_decides_without_rounding():
    for gap, pairs in [(1e-3, 0), (1e-300, 0), (0.0, 1), (-1e-300, 1), (-1e-3, 1)]:
        assert len(crossing_pairs(*two_patches(gap))) == pairs, gap


def test_the_judge_finds_the_pairs_that_ipctk_finds():
    random = np.random.default_rng(7)
    corners = random.uniform(0, 1, (400, 1, 3)) + random.uniform(-0.15, 0.15, (400, 3, 3))
    vertices, faces = corners.reshape(-1, 3), np.arange(1200).reshape(-1, 3)
    found = sorted(map(tuple, np.sort(crossing_pairs(vertices, faces)).tolist()))
    assert len(found) > 50
    assert found == crossing_triangles(vertices, faces)


def test_the_judge_finds_a_crossing_planted_in_a_cache(run_scene):
    out = run_scene("tests/scenes/two_sheets.toml", "0-2")
    caches = {name: hdf5(out / f"{name}.h5") for name in ("lower", "upper")}
    assert [len(Cloth(caches).crossings(index)) for index in range(3)] == [0, 0, 0]
    # One point of a sheet goes a micrometre below a triangle's middle of the other.
    lower, upper = (caches[name]["positions"] for name in ("lower", "upper"))
    corners = lower[1][caches["lower"]["face_indices"][:3] + 25 * 12]
    upper[1][300] = corners.mean(axis=0) - np.float32([0, 1e-6, 0])
    pairs = Cloth(caches).crossings(1)
    assert len(pairs) > 0
    names = {Cloth(caches).name(face).split()[0] for face in pairs[0]}
    assert names == {"lower", "upper"}


@pytest.mark.parametrize(
    ("scene", "frames", "parameters"),
    [
        ("tests/scenes/two_sheets.toml", "0-48", {}),
        ("tests/scenes/storm.toml", "0-60", {}),
        ("tests/scenes/folded_stack.toml", "0-60", {"resolution": 5}),
        (f"{SAMPLES}/leaves.toml", "0-110", {"rows": 1, "resolution": 4}),
        (f"{SAMPLES}/twister.toml", "0-120", {"resolution": 20}),
        (f"{SAMPLES}/spinning_ball.toml", "0-120", {}),
    ],
)
def test_cloth_never_crosses_cloth(scene, frames, parameters, run_scene, report_figure):
    assert_no_crossing(run_scene(scene, frames, **parameters), report_figure)


@pytest.mark.full
@pytest.mark.parametrize(
    ("scene", "frames", "parameters"),
    [
        ("tests/scenes/two_sheets.toml", "0-72", {"resolution": 100}),
        ("tests/scenes/storm.toml", "0-240", {"seed": 2}),
        ("tests/scenes/folded_stack.toml", "0-180", {}),
        (f"{SAMPLES}/leaves.toml", "0-180", {"rows": 1}),
        (f"{SAMPLES}/twister.toml", "0-900", {}),
        (f"{SAMPLES}/twister.toml", "0-240", {"resolution": 100}),
        (f"{SAMPLES}/spinning_ball.toml", "0-1200", {}),
        (f"{SAMPLES}/spinning_ball.toml", "0-1200", {"resolution": 100}),
        (f"{SAMPLES}/wardrobe.toml", "0-2400", {}),
        (f"{SAMPLES}/curtain_and_ball.toml", "0-420", {}),
    ],
)
def test_cloth_never_crosses_cloth_in_a_long_shot(scene, frames, parameters, run_scene, report_figure):
    assert_no_crossing(run_scene(scene, frames, **parameters), report_figure)


@pytest.mark.full
def test_the_real_characters_fine_garments_cross_neither_each_other_nor_her(run_scene, shared_data, report_figure):
    cloth = assert_no_crossing(run_scene("tests/scenes/dressed_woman.toml", "0-96", quality=""), report_figure)
    body = Body(shared_data / "woman_walk_dance" / "body.abc")
    assert_cloth_does_not_cross_the_body(cloth, body, report_figure)
