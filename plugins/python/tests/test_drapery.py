"""The wheel, as a user has it: same bits as a run, arrays, exceptions, Ctrl-C, memory."""

import gc
import logging
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import drapery

SCENE = {
    "drapery": 1,
    "shot": {"name": "table", "frames": "1001-1004", "preroll": {"settle": 1, "blend": 0}},
    "gravity": {},
    "self_repulsion": {},
    "self_collision": {},
    "body": [{"name": "table", "file": "memory:table"}],
    "garment": [{
        "name": "cloth", "material": "cotton_shirting",
        "panel": {"resolution": 6, "side": 0.8, "aspect": 1, "center": [0, 0.01, 0]},
    }],
}
FACES = [[0, 1, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]


def table(frame: int) -> np.ndarray:
    y = -0.02 + 0.01 * (frame - 1001)
    return np.array([[-0.3, y, -0.3], [-0.3, y, 0.3], [0.3, y, 0.3], [0.3, y, -0.3], [0, -0.5, 0]])


def scene(last: int = 1004) -> drapery.Scene:
    content = {**SCENE, "shot": {**SCENE["shot"], "frames": f"1001-{last}"}}
    made = drapery.Scene.from_dict(content, "table.toml")
    made.add_mesh("table", table(1001), FACES)
    return made


def advance(simulation: drapery.Simulation, frame: int) -> None:
    while simulation.frame < frame:
        simulation.move_body("table", table(simulation.frame + 1))
        simulation.advance()


def test_frames_have_the_bits_of_a_run(tmp_path: Path) -> None:
    told = []
    report = scene().run(tmp_path / "run", told.append)
    assert report.frame == 1004 and report.frames == 4 and not report.was_there
    assert [progress.frame for progress in told] == [1000, 1001, 1002, 1003, 1004]
    assert report.files == [tmp_path / "run" / "cloth.abc"]
    stepped, restored = scene().simulate(), scene().simulate()
    stepped.advance_to(1004)
    restored.restore_file(tmp_path / "run" / "checkpoints" / "frame_01004.h5")
    assert np.array_equal(stepped.positions(), restored.positions())
    assert np.array_equal(stepped.velocities("cloth"), restored.velocities("cloth"))
    assert scene().run(tmp_path / "run").was_there


def test_states_come_back_with_the_same_bits(tmp_path: Path) -> None:
    simulation = scene().simulate()
    start = simulation.positions()
    advance(simulation, 1002)
    state = simulation.save()
    assert state.frame == 1002 and "1002" in repr(state)
    advance(simulation, 1004)
    end = simulation.positions()
    simulation.restore(state)
    advance(simulation, 1004)
    assert np.array_equal(simulation.positions(), end) and not np.array_equal(start, end)
    with pytest.raises(drapery.DraperyError, match="ends at frame 1004"):
        simulation.advance()
    with pytest.raises(drapery.DraperyError, match="another simulation"):
        scene().simulate().restore(state)


def test_arrays_are_of_their_frame_and_cannot_be_written_to() -> None:
    simulation = scene().simulate()
    before = simulation.positions()
    kept = before.copy()
    assert before.shape == (49, 3) and before.dtype == np.float64 and not before.flags.writeable
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
    error = caught.value
    assert (error.code, error.object, error.frame, error.element) == (65, "table", 1001, 3)
    with pytest.raises(drapery.SceneError) as caught:
        drapery.Scene.parse("drapery = 1\n[gravty]\n", "wrong.toml")
    error = caught.value
    assert (error.code, error.object, error.element) == (78, "wrong.toml", 2) and "gravity" in str(error)
    with pytest.raises(drapery.InputError) as caught:
        drapery.Scene.load("no such file.toml")
    assert caught.value.code == 66
    with pytest.raises(drapery.DraperyError, match="no garment"):
        simulation.positions("skirt")
    with pytest.raises(drapery.SceneError):
        scene().set("shot.fraems", "1-2")


def test_settings_are_those_of_the_command(tmp_path: Path) -> None:
    file = tmp_path / "sheet.toml"
    file.write_text('drapery = 1\n[parameters]\nresolution = 4\n[shot]\nframes = "1-2"\n[gravity]\n[[garment]]\n'
                    'name = "sheet"\npanel = { resolution = "$resolution", aspect = 1 }\ndensity = "100 g/m²"\n')
    loaded = drapery.Scene.load(file, {"resolution": 5})
    assert loaded.simulate().positions().shape == (36, 3) and loaded.path == file
    loaded.set("resolution", np.int64(7))
    assert loaded.simulate().positions().shape == (64, 3) and "sheet" in repr(loaded)
    loaded.set("gravity.acceleration", [0, 0, 0])
    simulation = loaded.simulate()
    before = simulation.positions()
    simulation.advance()
    assert np.array_equal(before, simulation.positions()) and "at frame 2 of 1 to 2: sheet" in repr(simulation)


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(
    dtype=st.one_of(hnp.floating_dtypes(), hnp.integer_dtypes(), hnp.boolean_dtypes(), hnp.complex_number_dtypes()),
    shape=hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6),
))
def test_any_array_is_taken_or_refused(array: np.ndarray) -> None:
    simulation = HELD
    fits = array.dtype.kind in "fiu" and array.shape == (5, 3)
    try:
        simulation.move_body("table", array)
    except (ValueError, TypeError, drapery.InputError):
        assert not (fits and np.all(np.abs(array.astype(np.float64)) < 1e3))
    else:
        assert fits and np.all(np.isfinite(array.astype(np.float64)))


HELD = scene().simulate()


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(["f4", ">f8", "f8", "f2"]), st.booleans(), st.booleans())
def test_layouts_and_types_of_numbers_come_to_the_same(dtype: str, fortran: bool, strided: bool) -> None:
    positions = np.round(table(1001) * 64) / 64  # in half precision, too
    array = positions.astype(dtype, order="F" if fortran else "C")
    if strided:
        array = np.repeat(array, 2, axis=0)[::2]
    a, b = scene().simulate(), scene().simulate()
    a.move_body("table", positions)
    b.move_body("table", array)
    a.advance(), b.advance()
    assert np.array_equal(a.positions(), b.positions())


def test_other_threads_run_while_the_solver_works() -> None:
    simulation, ticks, over = scene(1010).simulate(), [0], threading.Event()

    def tick() -> None:
        while not over.wait(0.001):
            ticks[0] += 1

    thread = threading.Thread(target=tick)
    thread.start()
    advance(simulation, 1010)
    over.set()
    thread.join()
    assert ticks[0] > 2


def test_an_exception_of_progress_stops_at_a_checkpoint(tmp_path: Path) -> None:
    def stop(progress: drapery.Progress) -> None:
        if progress.frame == 1002:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        scene().run(tmp_path / "run", stop)
    told: list[drapery.Progress] = []
    scene().run(tmp_path / "run", told.append)
    assert [progress.frame for progress in told] == [1003, 1004]


LONG = """
import drapery, sys
made = drapery.Scene.parse('''drapery = 1
[shot]
name = "long"
frames = "1-100000"
[gravity]
[[garment]]
name = "sheet"
panel = { resolution = 20 }
material = "cotton_shirting"
[[garment.pin]]
corners = ["i0j0"]
''')
try:
    made.run(sys.argv[1], lambda progress: print(progress.frame, flush=True))
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_ctrl_c_stops_at_a_checkpoint(tmp_path: Path) -> None:
    run = subprocess.Popen([sys.executable, "-c", LONG, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    assert run.stdout.readline().strip() == "1"
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=60)
    assert run.returncode == 0 and out.strip().splitlines()[-1] == "stopped"
    assert list((tmp_path / "run" / "checkpoints").glob("*.h5"))


def test_messages_go_to_logging(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger="drapery")
    scene().run(tmp_path / "run")
    assert any("frame 1004" in record.getMessage() for record in caplog.records)


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
            simulation.positions(), simulation.velocities(), simulation.save()

    go_on(200)
    before = resident()
    go_on(1000)
    # An array of positions is 50 kB: one kept for each frame would be 50 MB.
    assert resident() - before < 8e6


def test_the_package_is_typed(tmp_path: Path) -> None:
    sample = tmp_path / "sample.py"
    sample.write_text(
        "import drapery\nfrom pathlib import Path\n\n\n"
        "def lowest(path: Path) -> float:\n"
        '    simulation = drapery.Scene.load(path, {"resolution": 8}).simulate()\n'
        "    frame: drapery.Frame = simulation.advance()\n"
        "    print(frame.counts, simulation.velocities().shape)\n"
        "    return float(simulation.positions()[:, 1].min())\n"
    )
    package = Path(drapery.__file__).parent
    for target in (sample, package):
        done = subprocess.run([sys.executable, "-m", "mypy", "--strict", str(target)], capture_output=True, text=True, cwd=tmp_path)
        assert done.returncode == 0, done.stdout
