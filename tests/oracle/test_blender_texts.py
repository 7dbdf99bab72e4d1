"""Work of the Blender add-on without Blender: scene files, answers of the command, fabrics, the zip."""

import importlib
import json
import math
import os
import subprocess
import sys
import tomllib
import types
import zipfile
from fractions import Fraction

import pytest

from conftest import program
from judges import ROOT
from test_blender_addon import package, wheel_in

ADD_ON = ROOT / "plugins" / "blender" / "drapery_cloth"

SQUARE = "v 0 {y} 0\nv 1 {y} 0\nv 1 {y} 1\nv 0 {y} 1\nf 4 3 2 1\n"


@pytest.fixture(scope="module")
def parts():
    """The modules that know nothing of Blender, without the package's own `__init__`, which does."""
    package = types.ModuleType("drapery_cloth")
    package.__path__ = [str(ADD_ON)]
    sys.modules["drapery_cloth"] = package
    yield types.SimpleNamespace(**{name: importlib.import_module(f"drapery_cloth.{name}")
                                   for name in ("scene_text", "answers", "fabrics", "process", "sewing")})  # fmt: skip
    for name in [name for name in sys.modules if name.startswith("drapery_cloth")]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def drapery():
    return program("DRAPERY", "drapery")


def run(*command, folder=None):
    return subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def scene_in(folder, parts, **changes):
    """A scene folder with all that the panel can ask for; the files are OBJ, which is all the same to the scene file."""
    text = parts.scene_text
    for name, y in (("floor", 0.0), ("cape", 1.0), ("coat", 1.2)):
        (folder / f"{name}.obj").write_text(SQUARE.format(y=y))
    for name, numbers in (("pins", "1 0 0 0"), ("heavy", "1 2 2 1"), ("springs", "0 1 1 0")):
        (folder / f"{name}.txt").write_text(numbers.replace(" ", "\n") + "\n")
    shot = text.Shot(**{"name": "a shot", "first": 1001, "last": 1003, "rate": Fraction(24000, 1001), "settle": 2, "blend": 1,
                        "preset": "hero", "wind": (1.5, 0.0, -2.0), "attributes": ("rest", "contact")} | changes)  # fmt: skip
    floor = text.Body("floor", "floor.obj", "floor.obj@1", 2.5, 0.4)
    pins = [text.Pin("pins.txt"), text.Pin("springs.txt", "floor", 123.0)]
    maps = [text.Map("density", "heavy.txt"), text.Map("pins", "springs.txt")]
    cape = text.Garment("cape", "cape.obj", "denim_11oz", 0.25, 1, pins, maps)
    coat = text.Garment("coat", "coat.obj", "canvas", None, 2, [], [], 0.061, True, None, text.RenderMesh("coat.obj"),
                        [(1001, 30.0), (1003, 40.0)], 14.0, 0.5, ("OPEN", 2.0))
    coat.rest_scale, coat.elastics = [(1001, 1.0), (1003, 0.9)], [text.Elastic("springs.txt", 15.0, 0.75), text.Elastic("springs.txt", [(1001, 1.0), (1002, 2.0)], 1.0)]
    surface = text.Seam(("cape", "coat"), "surface", [(1001, 100.0), (1002, 50.0)], keep_gap=True, break_force=2.5), [[0, 3], None]
    seam = text.Seam(("cape", "coat"), None, 321.5, -0.5, 1.25, 2.0, 2.5, True), [[3, 2], [0, 1]]
    nearest = text.Seam(("coat", "coat"), "nearest", 400.0), [[0], [2]]
    contacts = [text.Contact((("garment", "coat"), ("body", "floor")), True),
                text.Contact((("garment", "coat", "pocket"), ("garment", "coat")), False, 0.2)]
    coat.parts = [text.Part("pocket", "pins.txt")]
    written = text.scene_text(shot, [floor], [coat, cape], [seam, nearest, surface], contacts)
    (folder / text.SCENE_FILE).write_text(written)
    return written


def test_a_scene_with_everything_is_what_the_command_understands(parts, drapery, tmp_path):
    written = scene_in(tmp_path, parts)
    done = run(drapery, "plan", "scene.toml", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    plan = json.loads(done.stdout)
    assert plan["frames"] == [1001, 1003] and plan["fps"] == [24000, 1001]
    # In wearing order.
    assert [garment["name"] for garment in plan["garments"]] == ["cape", "coat"]
    resolved = tomllib.loads(plan["resolved"])
    assert resolved["solver"]["preset"] == "hero" and resolved["shot"]["preroll"] == {"settle": 2, "blend": 1}
    assert resolved["output"]["attributes"] == ["rest", "contact"]
    assert resolved["body"][0]["thickness"] == "2.5 mm" and resolved["body"][0]["friction"] == 0.4
    assert resolved["wind"] == {"velocity": [1.5, 0.0, -2.0], "density": "0.77 kg/m³", "tangential": "0.02 N s/m³"}
    cape, coat = resolved["garment"]
    assert (cape["layer"], coat["layer"]) == (1, 2)
    # The limit is that of canvas: nothing is written beside the table.
    assert "[garment.strain_limit]\n\n" in written and coat["strain_limit"]["limit"] == coat["stretch"]["extension"] == 0.061
    assert coat["render_mesh"]["file"].endswith("coat.obj") and "strain_limit" not in cape
    assert cape["thickness"] == "0.25 mm" and cape["maps"].keys() == {"density", "pins"}
    assert [(pin["to"], pin["mode"]) for pin in cape["pin"]] == [("start", "hard"), ("body:floor", "spring")]
    assert cape["pin"][1]["stiffness"] == "123 N/m"
    sewn, nearest, surface = resolved["seam"]
    assert surface["to"] == {"garment": "coat"} and surface["pairing"] == "surface" and surface["keep_gap"]
    assert surface["strength"] == [[1001, "100 N/m"], [1002, "50 N/m"]] and surface["break_force"] == "2.5 N"
    assert coat["rest_scale"] == [[1001, 1], [1003, 0.9]]
    assert [band["rest_scale"] for band in coat["elastic"]] == [0.75, 1] and coat["elastic"][1]["stiffness"] == [[1001, "1 N"], [1002, "2 N"]]
    assert sewn["from"] == {"garment": "cape", "vertices": [3, 2]} and sewn["to"] == {"garment": "coat", "vertices": [0, 1]}
    assert (sewn["strength"], sewn["start"], sewn["closed"]) == ("321.5 N/m", "-0.5 s", "1.25 s")
    assert (sewn["opens"], sewn["opened"], sewn["zip"]) == ("2 s", "2.5 s", True) and "opens" not in nearest and not nearest["zip"]
    assert nearest["pairing"] == "nearest"
    assert [(rule["between"], rule.get("ignore"), rule.get("friction")) for rule in resolved["contact"]] == [
        (["garment.coat", "body.floor"], True, None), (["garment.coat.pocket", "garment.coat"], False, 0.2)]
    assert [part["name"] for part in coat["part"]] == ["pocket"]
    assert {"seams", "elastic_bands", "gravity", "self_repulsion", "self_collision", "pins", "wind", "strain_limit"} <= {effect["effect"] for effect in plan["effects"]}


def test_a_belt_is_a_body_around_another(parts):
    belt = parts.scene_text.Belt("belt", "hero", (0.0, 1.02, -0.1), (0.0, 1.0, 0.0), 35.0, 4.5, 8.0)
    [table] = tomllib.loads("\n".join(parts.scene_text.belt_lines(belt)))["body"]
    assert table == {"name": "belt", "belt": {"around": "hero", "at": [0, 1.02, -0.1], "axis": [0, 1, 0], "width": "35 mm", "depth": "4.5 mm", "gap": "8 mm"}}


def test_cleared_boxes_ask_for_no_effect_and_give_no_warning(parts, drapery, tmp_path):
    scene_in(tmp_path, parts, gravity=None, self_contact=False, wind=None)
    plan = json.loads(run(drapery, "plan", "scene.toml", "--json", folder=tmp_path).stdout)
    assert not {"gravity", "self_repulsion", "self_collision", "wind"} & {effect["effect"] for effect in plan["effects"]}
    assert not {"no_gravity", "no_self_collision"} & {warning["rule"] for warning in plan["warnings"]}


@pytest.mark.parametrize("fps, base, rate", [(25, 1.0, "25"), (24, 1.0010000467300415, "24000/1001"), (24, 2.0, "12"),
                                             (30, 1.0010000467300415, "30000/1001"), (60, 1.0, "60")])  # fmt: skip
def test_frame_rates_are_those_of_cameras(parts, fps, base, rate):
    assert str(parts.scene_text.frame_rate(fps, base)) == rate


def test_names_that_files_cannot_tell_apart_are_found(parts):
    text = parts.scene_text
    assert text.plain_name("Röck 1") == "R_ck_1" and text.plain_name("..") == "_" and text.plain_name("$x") == "_x"
    assert text.names_taken_twice(["a:b", "a b", "c", "A_B", "C.001"]) == [["a:b", "a b", "A_B"]]


def test_texts_are_toml(parts):
    for words in ('quote " and \\', "ünïcode ☺", "line\nbreak", "\x7f\x01"):
        assert tomllib.loads(f"a = {parts.scene_text.quoted(words)}") == {"a": words}


def test_fabrics_are_the_presets_of_the_command(parts, drapery):
    listed = run(drapery, "materials").stdout.splitlines()
    heads = [line.split(":")[0] for line in listed if not line.startswith(" ")]
    assert heads == [fabric.name for fabric in parts.fabrics.FABRICS]
    figures = [line.split() for line in listed if line.startswith("  density")]
    for fabric, words in zip(parts.fabrics.FABRICS, figures, strict=True):
        assert abs(float(words[1]) * 1000 - fabric.mass) < 0.5 and abs(float(words[4]) - fabric.thickness) < 1e-6, fabric.name
    strains = [float(line.split("largest strain ")[1].split()[0]) for line in listed if "largest strain" in line]
    assert strains == [fabric.strain for fabric in parts.fabrics.FABRICS]


def test_every_fabric_has_a_picture_of_its_own(parts):
    size = parts.fabrics.PICTURE_SIZE
    pictures = [parts.fabrics.picture(fabric) for fabric in parts.fabrics.FABRICS]
    assert all(len(pixels) == 4 * size * size and 0.0 <= min(pixels) and max(pixels) <= 1.0 for pixels in pictures)
    for index, pixels in enumerate(pictures):
        for other in pictures[:index]:
            assert sum(abs(a - b) for a, b in zip(pixels, other)) / len(pixels) > 0.02


def test_problems_of_the_command_come_apart(parts, drapery, tmp_path):
    # A garment of which two corners lie below the floor's other side, in a mesh without the third.
    scene_in(tmp_path, parts)
    (tmp_path / "cape.obj").write_text(SQUARE.format(y=1.0).replace("f 4 3 2 1", "f 4 3 2 1\nf 4 4 1"))
    (tmp_path / "coat.obj").write_text(SQUARE.format(y=1.2).replace("v 1 1.2 1", "v nan 1.2 1"))
    done = run(drapery, "check", "scene.toml", "--json", folder=tmp_path)
    found = parts.answers.problems_of(done.stderr, (tmp_path / "scene.toml").read_text())
    assert done.returncode != 0 and found and all(problem.message for problem in found)
    assert any(problem.help for problem in found)


def test_a_list_of_problems_names_object_frame_and_element(parts):
    errors = ('Error: 2 problems\nbody "ball" (t.abc, /ball), frame 1002: the topology changes: 477 faces\n  help: export it again\n'
              'garment "cloth", vertex 60: inside body "ball"\n  help: move it\n')  # fmt: skip
    first, second = parts.answers.problems_of(errors)
    assert (first.object, first.frame, first.element, first.help) == ("ball", 1002, None, "export it again")
    assert (second.object, second.frame, second.element, second.index) == ("cloth", None, "vertex", 60)


def test_an_excerpt_of_the_scene_names_the_object_of_its_table(parts, drapery, tmp_path):
    written = scene_in(tmp_path, parts).replace('"canvas"', '"canvvas"')
    (tmp_path / "scene.toml").write_text(written)
    done = run(drapery, "check", "scene.toml", "--json", folder=tmp_path)
    (problem,) = parts.answers.problems_of(done.stderr, written)
    assert problem.object == "coat" and "canvvas" in problem.message and "canvas" in problem.help


@pytest.mark.parametrize("before, after", [("garment = \"cape\", vertices = [3, 2]", "garment = \"cape\", vertices = [3, 9]"),
                                           ('strength = "321.5 N/m"', "strenght = 3"), ('start = "-0.5 s"', "start = 9.0")])  # fmt: skip
def test_an_excerpt_of_a_seam_names_its_first_garment(parts, drapery, tmp_path, before, after):
    written = scene_in(tmp_path, parts)
    assert before in written
    written = written.replace(before, after)
    (tmp_path / "scene.toml").write_text(written)
    done = run(drapery, "check", "scene.toml", "--json", folder=tmp_path)
    assert "cape" in {problem.object for problem in parts.answers.problems_of(done.stderr, written)}, done.stderr


def test_a_group_is_walked_along_its_edges(parts):
    line_of, NoLine = parts.sewing.line_of, parts.sewing.NoLine
    assert line_of([7, 3, 5], [], [(5, 3), (7, 5), (9, 7)]) == ([3, 5, 7], False)
    assert line_of([4], [], []) == ([4], False)
    assert line_of([1, 2], [(1, 2)], [(1, 2)]) == ([1, 2], False)
    assert line_of([1, 2, 3, 4], [], [(1, 3), (3, 2), (2, 4), (4, 1)]) == ([1, 3, 2, 4], True)
    # A corner of one triangle, whose third edge is no border.
    assert line_of([1, 2, 3], [(1, 2), (2, 3)], [(1, 2), (2, 3), (3, 1)]) == ([1, 2, 3], False)
    for edges, words, vertex in (([(1, 2), (3, 4)], "it is in 2 pieces", 3), ([(1, 2), (1, 3), (1, 4)], "vertex 1 has 3 neighbours in it", 1),
                                 ([(1, 2), (2, 3), (3, 1)], "it is in 2 pieces", 1)):  # fmt: skip
        with pytest.raises(NoLine) as error:
            line_of([1, 2, 3, 4], [], edges)
        assert (str(error.value), error.value.vertex) == (words, vertex)


def test_the_second_side_is_turned_to_the_first(parts):
    # Ten centimetres beside and turned by 2 vertices, in the other direction.
    ring = [(math.cos(a), math.sin(a), 0.0) for a in (0.3 * k * k for k in range(4))]
    beside = {vertex: (x + 5.0, y, z + 0.1) for vertex, (x, y, z) in zip((40, 30, 20, 10), ring[2:] + ring[:2])}
    closest = parts.sewing.closest_order
    assert closest([0, 1, 2, 3], ring, [10, 20, 30, 40], beside, True) == [20, 10, 40, 30]
    assert closest([0, 1], ring, [40, 20], {40: (3.0, 0.0, 0.0), 20: (4.0, 0.0, 0.0)}, False) == [20, 40]


def test_a_missing_file_names_the_body(parts, drapery, tmp_path):
    written = scene_in(tmp_path, parts)
    (tmp_path / "floor.obj").unlink()
    done = run(drapery, "check", "scene.toml", "--json", folder=tmp_path)
    assert "floor" in {problem.object for problem in parts.answers.problems_of(done.stderr, written)}


def test_what_a_run_says_becomes_a_line(parts, drapery, tmp_path):
    scene = tmp_path / "sheet.toml"
    scene.write_text((ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml").read_text())
    assert run(drapery, "run", scene, "--frames", "1001-1003", "--out", tmp_path / "out", "--set", "resolution=4").returncode == 0
    status = parts.answers.status_of(run(drapery, "status", tmp_path / "out", "--json").stdout)
    assert parts.answers.headline(status) == "Done: 3 of 3 frames" and status.share == 1.0 and not status.running
    for seconds, words in ((12.4, "12 s"), (150.0, "2 min"), (3600.0 * 3 + 125.0, "3 h 2 min")):
        assert parts.answers.duration(seconds) == words


def test_warnings_of_a_run_are_read_from_its_log(parts, drapery, tmp_path):
    (tmp_path / "sheet.toml").write_text((ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml").read_text().replace(
        "[gravity]", "[gravity]\n[output]\nformat = [\"h5\"]", 1))  # fmt: skip
    done = run(drapery, "run", "sheet.toml", "--frames", "1001-1002", "--out", "out", "--set", "resolution=4", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (found,) = parts.answers.warnings_of_log((tmp_path / "out" / "logs" / "001.jsonl").read_text())
    assert found.warning and found.message.startswith("unopened_format: ") and found.help.startswith("write format = ")


def test_warnings_that_differ_by_numbers_are_one(parts):
    def line(message, level="WARN"):
        return json.dumps({"timestamp": "2026-11-24T19:11:57Z", "level": level, "fields": {"message": message}})

    log = [line('frame 8, time 0.291667 s: garment "coat", vertex 12: solve diverged; retried_shorter, and 26 more in this frame'),
           line("frame", "INFO"), line("frame 8: crossings is 12 and should stay zero: intersections"),
           line('frame 9, time 0.333333 s: garment "coat", vertex 7: solve diverged; retried_shorter, and 7 more in this frame'),
           line("body: it jumps\n  help: look at it"), line("cut")[:-9]]  # fmt: skip
    first, second = parts.answers.warnings_of_log("\n".join(log))
    assert first.message.endswith("in this frame (and 1 more like it)") and first.warning
    assert (first.object, first.frame, first.element, first.index) == ("coat", 8, "vertex", 12)
    assert (second.message, second.help, second.object) == ("body: it jumps", "look at it", None)


@pytest.mark.parametrize("state, words", [("killed", "without a message (killed, or the disk is full): 7 of 9 frames are kept"),
                                          ("stopped", "Stopped at a checkpoint"), ("silent", "its machine may be lost")])  # fmt: skip
def test_every_end_has_words(parts, state, words):
    assert words in parts.answers.headline(parts.answers.Status(state, 7, 9, 1007, None))


def test_the_solver_is_an_executable_or_a_wheel_or_a_sentence(parts, drapery, tmp_path, monkeypatch):
    process = parts.process
    assert process.find_solver(drapery).line("check", 1) == [drapery, "check", "1"]
    with pytest.raises(process.NoSolver, match="is not a program"):
        process.find_solver(str(tmp_path))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(process.NoSolver, match="no wheel for this machine"):
        process.find_solver("")


def test_a_simulation_has_a_session_of_its_own(parts, tmp_path):
    simulation = parts.process.Simulation(["sh", "-c", "echo Error: it is $(ps -o sid= -p $$ | tr -d ' ') >&2; exit 3"], str(tmp_path),
                                          dict(os.environ), tmp_path / "log")  # fmt: skip
    simulation._popen.wait()
    session = int(simulation.errors.split()[-1])
    assert simulation.code == 3 and session != os.getsid(0)


def test_the_zip_holds_the_add_on_and_its_wheel(tmp_path):
    wheel_in(tmp_path)
    done, path = package(tmp_path)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        manifest = archive.read("drapery_cloth/blender_manifest.toml").decode()
    said = tomllib.loads(manifest)
    assert said["platforms"] == ["linux-x64"] and [f"drapery_cloth/{wheel[2:]}" in names for wheel in said["wheels"]] == [True]
    assert path.name == f"drapery_cloth-{said['version']}-linux-x64.zip"
    assert "drapery_cloth/LICENSE-MIT" in names and "drapery_cloth/__init__.py" in names
    first = path.read_bytes()
    package(tmp_path)
    assert path.read_bytes() == first


@pytest.mark.parametrize("name, words", [("drapery-0.1.0-cp310-abi3-linux_aarch64.whl", "a platform that Blender does not run on"),
                                         ("drapery-0.1.0-cp311-cp311-linux_x86_64.whl", "a wheel for abi3 is wanted"),
                                         ("other-1.0-py3-none-any.whl", "is no wheel of the solver")])  # fmt: skip
def test_a_wheel_that_would_not_run_makes_no_zip(tmp_path, name, words):
    wheel_in(tmp_path).rename(tmp_path / name)
    done, _ = package(tmp_path)
    assert done.returncode == 1 and words in done.stderr
    assert not list(tmp_path.glob("*.zip"))


def test_a_missing_wheel_makes_no_zip(tmp_path):
    done, _ = package(tmp_path)
    assert done.returncode == 1 and "holds no wheel of the solver; `make dist` builds it" in done.stderr
    assert not list(tmp_path.iterdir())
