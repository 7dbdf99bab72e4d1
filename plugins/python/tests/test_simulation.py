"""Scenes and simulations as a user of the wheel has them: bits, arrays, exceptions, threads, memory."""

import gc
import pickle
import resource
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import drapery
from table_scene import FACES, SHEET, advance, scene, table


def test_frames_have_the_bits_of_a_run(tmp_path: Path) -> None:
    heard: list[drapery.Progress] = []
    report = scene().shot().run(tmp_path / "run", heard.append)
    assert report.outcome == "done" and (report.frame, report.frames) == (1004, 4)
    assert [progress.frame for progress in heard] == [1000, 1001, 1002, 1003, 1004]
    assert [progress.is_preroll for progress in heard] == [True, False, False, False, False]
    assert report.files == [tmp_path / "run" / name for name in ("cloth.abc", "cloth.h5")]
    stepped, restored = scene().simulate(), scene().simulate()
    stepped.advance_to(1004)
    restored.restore_file(tmp_path / "run" / "checkpoints" / "frame_01004.h5")
    assert np.array_equal(stepped.positions(), restored.positions())
    assert np.array_equal(stepped.velocities("cloth"), restored.velocities("cloth"))
    assert scene().shot().run(tmp_path / "run").outcome == "nothing to do"


def test_states_come_back_with_the_same_bits(tmp_path: Path) -> None:
    simulation = scene().simulate()
    start = simulation.positions()
    advance(simulation, 1002)
    state = simulation.save()
    simulation.save_file(tmp_path / "state.h5")
    assert state.frame == 1002 and "1002" in repr(state)
    advance(simulation, 1004)
    end = simulation.positions()
    simulation.restore(state)
    advance(simulation, 1004)
    assert np.array_equal(simulation.positions(), end) and not np.array_equal(start, end)
    other = scene().simulate()
    other.restore_file(tmp_path / "state.h5")
    advance(other, 1004)
    assert np.array_equal(other.positions(), end)
    with pytest.raises(drapery.UsageError, match="ends at frame 1004"):
        simulation.advance()
    with pytest.raises(drapery.UsageError, match="another simulation"):
        other.restore(state)


def test_numbers_that_are_set_hold_from_the_next_frame_on() -> None:
    fallen = []
    for gravity in ([0, -9.81, 0], np.array([0.0, -1.6, 0.0])):
        simulation = scene().simulate()
        advance(simulation, 1001)
        state = simulation.save()
        simulation.set("gravity.acceleration", gravity)
        before = simulation.positions()[:, 1].copy()
        advance(simulation, 1003)
        fallen.append((before - simulation.positions()[:, 1]).max())
        simulation.restore(state)
        advance(simulation, 1003)
        assert (before - simulation.positions()[:, 1]).max() == fallen[-1], "numbers that are set stay"
    assert fallen[0] > fallen[1]
    with pytest.raises(drapery.SceneError, match="the scene has no number `gravity.acelerate`"):
        simulation.set("gravity.acelerate", 1.0)
    with pytest.raises(drapery.SceneError, match="three numbers"):
        simulation.set("gravity.acceleration", 1.0)
    with pytest.raises(drapery.UsageError, match="is no number"):
        simulation.set("gravity.acceleration", "down")


def test_arrays_are_of_their_frame_are_not_copied_and_cannot_be_written_to() -> None:
    simulation = scene().simulate()
    before = simulation.positions()
    kept = before.copy()
    assert before.shape == (49, 3) and before.dtype == np.float64 and not before.flags.writeable
    assert before.flags.c_contiguous and before.base is not None, "it stands on the solver's own memory"
    counts, corners = simulation.faces()
    assert counts.sum() == corners.size and corners.max() == 48
    frame = simulation.advance()
    assert frame.frame == 1001 and frame.steps > 0 and simulation.summary == frame
    assert np.array_equal(before, kept) and not np.array_equal(simulation.positions(), kept)
    del simulation
    gc.collect()
    assert np.array_equal(before, kept), "an array outlives its simulation"


def test_exceptions_have_code_object_frame_and_element() -> None:
    simulation = scene().simulate()
    wrong = table(1001)
    wrong[3, 1] = np.nan
    with pytest.raises(drapery.InputError) as caught:
        simulation.move_body("table", wrong)
    error: drapery.DraperyError = caught.value
    assert (error.code, error.object, error.frame, error.element) == (65, "table", 1001, 3)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.element) == (drapery.InputError, str(error), 3)
    with pytest.raises(drapery.SceneError) as of_scene:
        drapery.Scene.parse("drapery = 1\n[gravty]\n", "wrong.toml")
    error = of_scene.value
    assert (error.code, error.object, error.element) == (78, "wrong.toml", 2) and "gravity" in str(error)
    with pytest.raises(drapery.InputError, match="no such file.toml") as of_file:
        drapery.Scene.load("no such file.toml")
    assert of_file.value.code == 66
    with pytest.raises(drapery.UsageError, match="(?s)no garment.*cloth"):
        simulation.positions("skirt")
    made = scene()
    with pytest.raises(drapery.SceneError):
        made.set("shot.fraems", "1-2")
    assert made.validate() == scene().validate(), "a key that is refused changes nothing"
    values: list[Any] = [{1, 2}, None, float("nan"), b"bytes", np.array([1j])]
    for value in values:
        with pytest.raises(drapery.UsageError, match=r"body\[0\].position"):
            drapery.Scene.from_dict({"drapery": 1, "body": [{"position": value}]})


def test_settings_are_those_of_the_command(tmp_path: Path) -> None:
    file = tmp_path / "sheet.toml"
    file.write_text(SHEET)
    loaded = drapery.Scene.load(file, {"resolution": 5})
    assert loaded.simulate().positions().shape == (36, 3) and loaded.path == file
    loaded.set("resolution", np.int64(7))
    assert loaded.simulate().positions().shape == (64, 3) and "sheet" in repr(loaded)
    loaded.set("garment.sheet.panel", {"resolution": 2, "side": 0.5, "aspect": 1})
    assert np.ptp(loaded.simulate().positions()[:, 0]) == pytest.approx(0.5)
    loaded.set("gravity.acceleration", [0, 0, 0])
    simulation = loaded.simulate()
    before = simulation.positions()
    simulation.advance()
    assert np.allclose(before, simulation.positions(), atol=1e-9) and "at frame 2 of 1 to 6: sheet" in repr(simulation)


def test_a_plan_says_what_runs_and_why() -> None:
    plan = scene().plan()
    assert plan["shot"] == "table" and plan["frames"] == [1001, 1004] and plan["garments"][0]["points"] == 49
    assert {"gravity", "self_collision"} <= {effect["effect"] for effect in plan.effects}
    assert "gravity: the scene has a table [gravity]" in repr(plan) and "<td>gravity</td>" in plan._repr_html_()
    without = drapery.Scene.from_dict({"drapery": 1, "shot": {"frames": "1-2"}, "garment": [
        {"name": "sheet", "panel": {"resolution": 4}, "material": "cotton_shirting"}]})
    assert "no_gravity" in {warning.rule for warning in without.validate()}


def test_faces_are_taken_in_every_form() -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    points = [[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]]

    def positions(faces: Any) -> npt.NDArray[np.float64]:
        made = drapery.Scene.from_dict({"drapery": 1, "shot": {"frames": "1-2"}, "gravity": {}, "garment": [
            {"name": "sheet", "rest": "memory:sheet", "material": "cotton_shirting"}]})
        made.add_mesh("sheet", points, faces)
        simulation = made.simulate()
        simulation.advance()
        return simulation.positions()

    flat = drapery.Faces(np.array([3, 3], np.uint32), triangles.ravel().astype(np.uint32))
    assert np.array_equal(positions(triangles), positions(triangles.tolist()))
    assert np.array_equal(positions(triangles.astype(">i2")), positions(flat))
    made = scene()
    with pytest.raises(drapery.InputError, match="point 7 of 4") as caught:
        made.add_mesh("sheet", points, [[0, 1, 7]])
    assert caught.value.element == 2
    refused: list[Any] = [[[0, 1, -1]], [[0, 1, 2.5]], np.zeros((2, 2, 3), int), np.zeros((2, 3)), [[0, 1, 2 ** 40]]]
    for wrong in refused:
        with pytest.raises(drapery.UsageError):
            made.add_mesh("sheet", points, wrong)
    with pytest.raises(drapery.InputError, match="2 corners"):
        made.add_mesh("sheet", points, [[0, 1]])


HELD = scene().simulate()


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(
    dtype=st.one_of(
        hnp.floating_dtypes(), hnp.integer_dtypes(), hnp.boolean_dtypes(), hnp.complex_number_dtypes(), hnp.unicode_string_dtypes(),
    ),
    shape=hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6) | st.just((5, 3)),
))
def test_any_array_is_taken_or_refused(array: npt.NDArray[Any]) -> None:
    fits = array.dtype.kind in "fiu" and array.shape == (5, 3)
    try:
        HELD.move_body("table", array)
    except (drapery.UsageError, drapery.InputError):
        assert not (fits and np.all(np.abs(array.astype(np.float64)) < 1e3))
    else:
        assert fits and np.all(np.isfinite(array.astype(np.float64)))


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(["f4", ">f8", "f8", "f2", "f16"]), st.booleans(), st.booleans(), st.booleans())
def test_layouts_and_types_of_numbers_come_to_the_same(dtype: str, fortran: bool, strided: bool, frozen: bool) -> None:
    positions = np.round(table(1001) * 64) / 64  # in half precision, too
    array = positions.astype(dtype, order="F" if fortran else "C")
    if strided:
        array = np.repeat(array, 2, axis=0)[::2]
    array.setflags(write=not frozen)
    a, b = scene().simulate(), scene().simulate()
    a.move_body("table", positions)
    b.move_body("table", array)
    a.advance()
    b.advance()
    assert np.array_equal(a.positions(), b.positions())


def test_other_threads_run_while_the_solver_works_and_one_at_a_time_uses_a_simulation() -> None:
    made = scene(1040)
    made.set("garment.cloth.panel.resolution", 30)
    simulation, ticks, over, refused = made.simulate(), [0], threading.Event(), []

    def tick() -> None:
        while not over.wait(0.001):
            ticks[0] += 1
            try:
                simulation.positions()
            except drapery.UsageError as error:
                refused.append(str(error))

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        for _ in range(3):
            while True:
                try:
                    simulation.advance()
                    break
                except drapery.UsageError:
                    pass  # the other thread looks at it
    finally:
        over.set()
        thread.join()
    assert ticks[0] > 2 and "another call uses this simulation" in refused[0]


def test_a_signal_handler_that_raises_stops_a_frame_which_goes_on_with_the_same_bits() -> None:
    # Signals are looked for every 50 ms: a frame has to take many times as long, on any machine.
    resolution, took = 40, 0.0
    while took < 1.0:
        resolution += 40
        made = scene(1003)
        made.set("garment.cloth.panel.resolution", resolution)
        whole, began = made.simulate(), time.perf_counter()
        whole.advance()
        took = time.perf_counter() - began
    stopped = made.simulate()
    stops, refusals = 0, []

    def handler(number: int, frame: object) -> None:
        try:
            stopped.positions()
        except drapery.UsageError as error:
            refusals.append(error)
        raise TimeoutError

    # The first signals come well inside the frame, later ones leave it ever more time, so that it ends.
    delay = 0.01
    earlier = signal.signal(signal.SIGALRM, handler)
    try:
        while stopped.frame < 1001:
            signal.setitimer(signal.ITIMER_REAL, delay)
            delay *= 1.5
            try:
                stopped.advance()
            except TimeoutError:
                stops += 1
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
    finally:
        signal.signal(signal.SIGALRM, earlier)
    assert stopped.frame == whole.frame == 1001
    assert stops > 0 and refusals and np.array_equal(stopped.positions(), whole.positions())


def test_memory_is_stable_over_a_thousand_frames() -> None:
    made = drapery.Scene.from_dict({
        "drapery": 1, "shot": {"name": "still", "frames": "0-1300"}, "gravity": {},
        "garment": [{"name": "sheet", "panel": {"resolution": 40}, "density": "100 g/m²", "stretch": {"stiffness": "1 N/m"}}],
    })
    simulation = made.simulate()

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    def go_on(frames: int) -> None:
        for _ in range(frames):
            simulation.advance()
            simulation.positions(), simulation.velocities(), simulation.faces(), simulation.save()

    go_on(200)
    before = resident()
    go_on(1000)
    # An array of positions is 40 kB: one kept for each frame would be 40 MB.
    assert resident() - before < 8e6
