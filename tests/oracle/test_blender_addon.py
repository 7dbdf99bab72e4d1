"""The Blender add-on in real Blender: installed as an extension, the buttons pressed by a script, and nothing left behind."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from blender_session import package
from conftest import program
from judges import HERE, ROOT, official, z_up

FRAMES = 6
ADD_ON = ROOT / "plugins" / "blender" / "drapery_cloth"
# Runs the command in the place of the solver in a wheel: which way it is called is what is tested.
STAND_IN = "import os, sys\nos.execv(os.environ['DRAPERY'], ['drapery', *sys.argv[1:]])\n"


@pytest.fixture(scope="module")
def drapery():
    return program("DRAPERY", "drapery")


def wheel_in(folder):
    """A wheel like the solver's that calls the built command."""
    path = folder / "drapery-0.1.0-cp310-abi3-manylinux_2_17_x86_64.whl"
    info = "drapery-0.1.0.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("drapery/__init__.py", "")
        archive.writestr("drapery/__main__.py", STAND_IN)
        archive.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: drapery\nVersion: 0.1.0\n")
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: false\n"
                         "Tag: cp310-abi3-manylinux_2_17_x86_64\n")  # fmt: skip
        names = ["drapery/__init__.py", "drapery/__main__.py", f"{info}/METADATA", f"{info}/WHEEL", f"{info}/RECORD"]
        archive.writestr(f"{info}/RECORD", "".join(f"{name},,\n" for name in names))
    return path


def act(name, folder, archive, drapery, executable=None):
    """Runs an act of blender_addon.py; returns the arrays that it wrote."""
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user"), "DRAPERY": drapery}
    command = [sys.executable, str(HERE / "blender_addon.py"), name, str(folder), str(archive), executable or "none"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, f"{done.stdout[-4000:]}{done.stderr[-4000:]}"
    # A panel or a timer that fails prints and goes on.
    assert "Traceback" not in done.stdout + done.stderr, done.stdout + done.stderr
    with np.load(folder / f"{name}.npz", allow_pickle=False) as arrays:
        return {key: arrays[key] for key in arrays.files}


@pytest.fixture(scope="module")
def whole_path(tmp_path_factory, drapery):
    folder = tmp_path_factory.mktemp("whole path")
    wheel_in(folder)
    done, archive = package(folder)
    assert done.returncode == 0, done.stderr
    return folder, act("whole_path", folder, archive, drapery)


def test_every_frame_and_half_frame_shows_the_cache(whole_path):
    folder, saw = whole_path
    cache = official(folder / "drapery" / "out" / "Scene" / "Skirt.001.abc")
    positions = z_up(cache["world_positions"])
    assert len(positions) == FRAMES and list(saw["loaded"]) == ["FINISHED"]
    # In the scene's unit, a hundredth of a metre, below parents that turn, shrink and move.
    halves = (positions[1:] + positions[:-1]) / 2.0
    scale = np.abs(positions).max() * 100.0
    np.testing.assert_allclose(saw["positions"][0::2], 100.0 * positions, atol=2e-7 * scale)
    np.testing.assert_allclose(saw["positions"][1::2], 100.0 * halves, atol=2e-7 * scale)
    # It moves: a cache that stands still would be as easy to show.
    assert np.abs(positions[-1] - positions[0]).max() > 0.005


def test_velocities_are_there_for_motion_blur(whole_path):
    folder, saw = whole_path
    cache = official(folder / "drapery" / "out" / "Scene" / "Skirt.001.abc")
    np.testing.assert_array_equal(saw["velocities"][0::2], z_up(cache["velocities"]))


def test_uvs_and_materials_are_untouched(whole_path):
    _, saw = whole_path
    for uvs, materials in zip(saw["uvs"], saw["materials"]):
        np.testing.assert_array_equal(uvs, saw["own_uvs"])
        np.testing.assert_array_equal(materials, saw["own_materials"])


def test_the_body_that_is_simulated_is_the_one_that_is_rendered(whole_path):
    folder, saw = whole_path
    body = official(folder / "drapery" / "meshes" / "body_b_dy.abc")
    np.testing.assert_allclose(z_up(body["world_positions"]), saw["bodies"] * 0.01, atol=1e-6)


def test_check_plan_and_simulate_say_what_they_did(whole_path):
    _, saw = whole_path
    assert list(saw["checked"]) == ["No problems"] and not saw["dirty_after_check"]
    assert "Skirt.001: 144 vertices" in saw["planned"] and "1 body: b_dy" in saw["planned"]
    assert saw["status"] == "done" and not len(saw["problems"]) and saw["simulated"] == "FINISHED"


def test_loading_twice_and_undo_leave_what_was_there(whole_path):
    _, saw = whole_path
    # Before Solidify, which follows the cloth.
    assert list(saw["loaded_modifiers"]) == ["Drapery Cache", "Thickness"]
    assert list(saw["loaded_twice"]) == ["Drapery Cache", "Thickness", "1"]
    assert saw["unloaded_same"] and saw["undone_same"]


def test_the_same_scene_again_is_done_already(whole_path):
    _, saw = whole_path
    assert list(saw["again"]) == ["done", "False"]


def test_the_scene_folder_runs_elsewhere_by_the_command_alone(whole_path, drapery, tmp_path):
    folder, _ = whole_path
    subprocess.run(["cp", "-r", folder / "drapery", tmp_path / "farm"], check=True)
    subprocess.run(["rm", "-r", tmp_path / "farm" / "out"], check=True)
    subprocess.run([drapery, "run", "scene.toml", "--progress", "none"], cwd=tmp_path / "farm", check=True, capture_output=True)
    cache = Path("out", "Scene", "Skirt.001.abc")
    assert (tmp_path / "farm" / cache).read_bytes() == (folder / "drapery" / cache).read_bytes()


def test_the_panel_asks_for_what_this_blender_has(whole_path):
    # No panel is drawn without a window: test_blender_window.py draws them in an older Blender, which has no progress bars.
    _, saw = whole_path
    assert {"factor", "text"} <= set(saw["progress"])
    source = (ADD_ON / "panels.py").read_text()
    icons = set(re.findall(r'icon="([A-Z_0-9]+)"|, "([A-Z_0-9]+)"\)', source))
    names = {name for pair in icons for name in pair if name}
    assert len(names) > 10 and names <= set(saw["icons"]), names - set(saw["icons"])
    assert list(saw["fabrics"][:2]) == ["silk_light", "polyester_lining"]


@pytest.fixture(scope="module")
def problems(tmp_path_factory, drapery):
    folder = tmp_path_factory.mktemp("problems")
    _, archive = package("--without-solver", folder)
    return act("problems", folder, archive, drapery)


@pytest.mark.parametrize(
    "when, words",
    [
        ("unsaved", "relative to a file that was not saved yet|save the file, or choose a folder"),
        ("unsaved", "No object is marked as a garment|select a mesh"),
        ("no_solver", "this zip held no wheel for this machine. Install the zip of your platform, or choose a drapery executable"),
        ("no_program", "shot.blend is not a program"),
        ("together", '2 garments would have one name, SKIRT.001: "SKIRT.001", "Skirt.001"|rename them'),
        ("together", 'wire|None|None|None|"wire" has no faces'),
        ("together", "Fine gives other vertices in the render than in the window"),
        ("together", "the map for density is empty"),
        ("exported", "b_dy|1004|None|None|\"bödy\" changes its topology at frame 1004"),
        ("exported", "its modifiers: Armature, Subdivision, Shrinking"),
        ("exported", '"Skirt.001" has no attribute "weight of nothing"'),
        ("exported", 'no vertex of vertex group "waist ☺" is above one half'),
        ("inside", "Skirt.001|None|vertex|7|1 of its vertices start inside body"),
        ("no_folder", "Not a directory|make room on the disk, or choose a folder that can be written"),
        ("read_only", "/sys/drapery: "),
        ("one_folder", 'The scene "Scene 2" has the same folder'),
        ("nothing_to_load", "holds no caches: simulate first, or choose the folder that the farm has written"),
    ],
)
def test_what_is_wrong_is_said_in_the_panel(problems, when, words):
    assert any(words in line for line in problems[when]), "\n".join(problems[when])


def test_a_button_without_a_solver_or_with_a_problem_is_cancelled(problems):
    assert list(problems["results"]) == ["check CANCELLED", "plan CANCELLED", "simulate CANCELLED", "inside FINISHED"]


def test_show_goes_to_the_object_the_frame_and_the_vertex(problems):
    assert list(problems["shown"]) == ["Skirt.001", "1001", "[7]"]
    np.testing.assert_allclose(problems["cursor"], problems["vertex"], atol=1e-4)


def test_an_old_blender_is_told_what_it_needs(problems):
    assert problems["too_old"] == "Drapery needs Blender 4.2 or later; this is 2.93.0" and problems["new_enough"] == ""


def test_files_and_scenes_have_folders_of_their_own(problems):
    assert problems["own_folder"] == "drapery/shot/Scene" and problems["own_folder_too"] == "drapery/shot/Scene_2"


def test_problems_leave_no_scene_that_looks_valid(problems):
    assert "scene.toml" in problems["left_behind"]  # of the check that the solver made
    assert not [name for name in problems["left_behind"] if name.endswith((".part", ".new"))]


def test_rest_frames_subdivided_cloth_springs_and_colours(tmp_path, drapery):
    _, archive = package("--without-solver", tmp_path)
    saw = act("other_settings", tmp_path, archive, drapery, drapery)
    assert "set Blend to some frames" in saw["no_blend"][0]
    assert not len(saw["checked"]) and not len(saw["problems"]) and saw["status"] == "done"
    assert list(saw["loaded"]) == ["Fine", "Drapery Cache"]
    scene = tomllib.loads((tmp_path / "drapery" / "scene.toml").read_text())
    assert scene["shot"] == {"name": "Scene", "fps": "24000/1001", "frames": "1001-1001", "preroll": {"settle": 1, "blend": 4}}
    assert scene["body"][0]["rest"] == "meshes/rest_b_dy.abc@1006"
    (garment,) = scene["garment"]
    assert garment["pin"][0]["mode"] == "spring" and garment["pin"][0]["to"] == "body:b_dy"
    # Of the subdivided mesh: 16 x 9 vertices, 16 x 8 faces and the edges between them.
    paint = np.loadtxt(tmp_path / "drapery" / garment["maps"]["dihedral_bending"].removeprefix("file:"))
    assert paint.shape == (16 * 9 + 16 * 8 + 16 * 9 + 16 * 8,) and np.all(paint == 0.5)
    cache = official(tmp_path / "drapery" / "out" / "Scene" / "Skirt.001.abc")
    np.testing.assert_allclose(saw["positions"], 100.0 * z_up(cache["world_positions"][0]), atol=2e-5)


def test_stiffening_cloth_in_wind_with_a_render_mesh(tmp_path, drapery):
    _, archive = package("--without-solver", tmp_path)
    saw = act("effects", tmp_path, archive, drapery, drapery)
    assert ["is not known of its material" in saw["unknown"][0], "is a garment or a body" in saw["unknown"][1]] == [True, True]
    assert saw["simulated"] == "FINISHED" and list(saw["loaded"]) == ["FINISHED"] and not len(saw["problems"])
    run = tmp_path / "drapery" / "out" / "Scene"
    resolved = tomllib.loads((run / "resolved.toml").read_text())
    # Blender's (1, 2, 3) with Y up; the largest strain of the fabric as `drapery materials` has it.
    assert resolved["wind"]["velocity"] == [1.0, 3.0, -2.0]
    (garment,) = resolved["garment"]
    assert garment["stretch"]["extension"] == 0.085 and garment["strain_limit"]["limit"] == 0.085
    assert garment["render_mesh"]["rigid"] == ["button*"]
    # The render mesh stands where its cache says, before Solidify, which follows it; buttons keep their shape.
    cache = z_up(official(run / "Skirt.001_render.abc")["world_positions"])
    np.testing.assert_allclose(saw["positions"], 100.0 * cache, atol=1e-4)
    assert list(saw["modifiers"]) == ["Drapery Cache", "Thickness"] and list(saw["unloaded"]) == ["Thickness"]
    # Faces 100, 101, 132 and 133: a block of rows 3 and 4, columns 4 to 6.
    corners = [32 * row + column for row in (3, 4, 5) for column in (4, 5, 6)]
    lengths = np.linalg.norm(cache[:, corners, None] - cache[:, None, corners], axis=-1)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(len(lengths), 0), atol=2e-6)
    assert np.abs(cache[-1] - cache[0]).max() > 0.005
    scene = tomllib.loads((tmp_path / "drapery" / "scene.toml").read_text())
    assert scene["garment"][0]["stretch"]["extension"] == scene["garment"][0]["strain_limit"]["limit"] == 0.12


@pytest.fixture(scope="module")
def long_run(tmp_path_factory, drapery):
    folder = tmp_path_factory.mktemp("long")
    _, archive = package("--without-solver", folder)
    library = folder / "faults.so"
    subprocess.run(["cc", "-shared", "-fPIC", str(HERE / "faults.c"), "-o", str(library), "-ldl"], check=True)
    script = folder / "full_disk"
    script.write_text(f'#!/bin/sh\nLD_PRELOAD="{library}" FAULT=full FAULT_AT=40 FAULT_FOLDER="{folder}/drapery/out" '
                      f'FAULT_REPORT="{folder}/faults.txt" exec "{drapery}" "$@"\n')  # fmt: skip
    script.chmod(0o755)
    return folder, act("closed", folder, archive, drapery, drapery), act("reopened", folder, archive, drapery, drapery)


def test_progress_has_frames_and_time_left(long_run):
    _, closed, _ = long_run
    assert " of 120 frames, " in str(closed["headline"]) and str(closed["headline"]).endswith(" left")
    assert 0.0 < closed["share"] < 1.0


def test_blender_may_be_closed_and_finds_the_simulation_again(long_run):
    _, _, reopened = long_run
    assert reopened["found"] == "running"
    # Cancel, but not Simulate.
    assert list(reopened["busy_buttons"]) == [False, True]


def test_cancel_stops_at_a_checkpoint_and_continue_goes_on(long_run):
    _, _, reopened = long_run
    assert str(reopened["cancelled"]).startswith("Stopped at a checkpoint: ") and reopened["frames_then"] < 120


def test_a_killed_process_is_named_and_loses_nothing(long_run):
    _, _, reopened = long_run
    assert "killed" in str(reopened["killed"]) and "Continue resumes it" in str(reopened["killed"])
    assert reopened["done"] == "Done: 120 of 120 frames" and not len(reopened["problems"])


def test_a_full_disk_is_named(long_run):
    _, _, reopened = long_run
    assert reopened["full_state"] in ("failed", "killed") and any("No space left on device" in line for line in reopened["full"])


def test_a_run_after_cancel_kill_and_full_disk_has_the_bytes_of_one_that_was_left_alone(long_run, drapery, tmp_path):
    folder, _, reopened = long_run
    # The scene folder holds another fabric by now; what the run was made of stands in the run.
    resolved = folder / "drapery" / "out" / "Scene" / "resolved.toml"
    subprocess.run([drapery, "run", str(resolved), "--out", str(tmp_path / "alone"), "--progress", "none"], check=True, capture_output=True)
    assert (tmp_path / "alone" / "dress.abc").read_bytes() == (resolved.parent / "dress.abc").read_bytes()
    cache = z_up(official(resolved.parent / "dress.abc")["world_positions"])
    np.testing.assert_allclose(reopened["positions"], 100.0 * cache[[0, -1]], atol=1e-4)


def test_a_changed_scene_is_refused_and_kept_only_by_a_wish(long_run):
    _, _, reopened = long_run
    assert reopened["refused"][0] == "True" and "of a different shot" in reopened["refused"][1]


def test_scripts_hear_how_it_ended(long_run):
    _, _, reopened = long_run
    # Cancel, Continue to the end, and a scene that the run refuses.
    assert list(reopened["results"]) == ["FINISHED", "FINISHED", "CANCELLED"]


def test_an_edited_mesh_takes_no_cache(long_run):
    _, _, reopened = long_run
    assert '"dress" has 2761 vertices, its cache 2760: the mesh or its modifiers were changed' in reopened["edited"][0]
