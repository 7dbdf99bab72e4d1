"""Runs that are looked at in Blender while they go on, previews, colours of strain and contact, and keyframed settings.

In the module of Blender 5.0 and, but for colours, in Debian's 3.4, which has neither Alembic nor numpy.
"""

import importlib
import subprocess
import sys
import tomllib
import types

import igl
import numpy as np
import pytest

from blender_session import blender_does, exporter_in, needs_blender, package
from conftest import program
from judges import ROOT, both_cuts, official, z_up

ADD_ON = ROOT / "plugins" / "blender" / "drapery_cloth"
ADDED = ["Drapery Cache Rotation", "Drapery Cache Scale", "Drapery Cache Location"]


@pytest.fixture(scope="module")
def parts():
    """The modules that read caches and measure, without Blender."""
    package = types.ModuleType("drapery_cloth")
    package.__path__ = [str(ADD_ON)]
    sys.modules["drapery_cloth"] = package
    yield types.SimpleNamespace(**{name: importlib.import_module(f"drapery_cloth.{name}") for name in ("ogawa", "recording", "measures")})
    for name in [name for name in sys.modules if name.startswith("drapery_cloth")]:
        del sys.modules[name]


def act_of(blender, name, tmp_path_factory):
    needs_blender(blender)
    folder = tmp_path_factory.mktemp(name)
    _, archive = package("--without-solver", folder)
    exporter = exporter_in(folder) if blender == "debian" else "none"
    said, answer = blender_does(blender, "blender_live.py", folder, f"{name}.json", name, folder, archive, program("DRAPERY", "drapery"),
                                exporter)  # fmt: skip
    assert "Traceback" not in said, said[-4000:]
    return folder, answer


@pytest.fixture(scope="module", params=["module", "debian"])
def follows(request, tmp_path_factory):
    return act_of(request.param, "follows", tmp_path_factory)


@pytest.fixture(scope="module", params=["module", "debian"])
def curves(request, tmp_path_factory):
    return act_of(request.param, "curves", tmp_path_factory)


@pytest.fixture(scope="module")
def looks(tmp_path_factory):
    return act_of("module", "looks", tmp_path_factory)


def cache(folder, name):
    return official(folder / "drapery" / "out" / "Scene" / f"{name}.abc")


# ---- The Live View.


def test_garments_show_the_frames_that_are_written_while_the_run_goes_on(follows):
    folder, saw = follows
    positions = z_up(cache(folder, "cloth")["world_positions"])
    last = saw["frames"][2]
    assert 3 <= last < 200 and saw["added"] == ["Drapery Live", "Thickness", *ADDED]
    # Behind the newest frame that one is shown, before the shot the first.
    for frame, found in zip((1, saw["frames"][1], last, last, 1), saw["positions"], strict=True):
        np.testing.assert_allclose(found, positions[frame - 1], atol=1e-6)
    np.testing.assert_allclose(saw["last_positions"], positions[saw["last"] - 1], atol=1e-6)
    assert np.abs(positions[last - 1] - positions[0]).max() > 0.005


def test_a_frame_that_is_not_there_is_marked(follows):
    _, saw = follows
    last = saw["frames"][2]
    assert saw["before"] == [["No frame is simulated yet: the rest pose is shown", True], ["Thickness"]]
    assert saw["notes"] == [[f"Frame 1 of 1 to {last}", False], [f"Frame {last // 2} of 1 to {last}", False], [f"Frame {last} of 1 to {last}", False],
                            [f"Frame {last + 5} is not simulated yet: frame {last} is shown", True],
                            ["Frame -3 is before the shot: frame 1 is shown", True]]  # fmt: skip


def test_the_view_outlives_undo_opening_cancelling_and_a_folder_that_is_gone(follows):
    _, saw = follows
    live = ["Drapery Live", "Thickness", *ADDED]
    assert saw["undone"] == [False, 1, ["Thickness"]] and saw["after_undo"] == live
    assert saw["opened"] == [live, "running", True] and saw["newest"] and saw["cancelled"] == [["FINISHED"], "stopped"]
    note, added, rest = saw["moved"]
    assert note == ["No frame is simulated yet: the rest pose is shown", True] and added == ["Thickness"] and saw["moved_back"]
    np.testing.assert_allclose(rest, saw["positions"][0], atol=1e-5)
    assert len(saw["cut"]) == 1 and saw["cut"][0].endswith("cloth.abc is cut off") and saw["whole"] == []


def test_load_takes_the_place_of_the_view_and_off_leaves_nothing(follows):
    _, saw = follows
    assert saw.get("loaded", [["FINISHED"], False, ["Drapery Cache", "Thickness", *ADDED]]) == [
        ["FINISHED"], False, ["Drapery Cache", "Thickness", *ADDED]]  # fmt: skip
    assert saw["off"] == [["Thickness"], []]


def test_caches_and_exports_are_read_as_the_official_library_reads_them(parts, looks):
    folder, _ = looks
    for path in (folder / "drapery" / "out" / "Scene" / "strip.abc", folder / "drapery" / "meshes" / "garment_strip.abc",
                 folder / "drapery" / "meshes" / "body_floor.abc"):  # fmt: skip
        known = official(path)
        with parts.ogawa.Archive(path) as archive:
            mesh = archive.mesh()
            assert mesh.samples == len(known["positions"]) and archive.mesh(mesh.path).path == mesh.path
            found = [parts.measures.transformed(mesh.positions(index), mesh.matrices()) for index in range(mesh.samples)]
            counts, corners = (np.frombuffer(values, np.int32) for values in mesh.faces())
        np.testing.assert_allclose(found, known["world_positions"], atol=1e-7)
        np.testing.assert_array_equal(counts, known["face_counts"])
        np.testing.assert_array_equal(corners, known["face_indices"])


def test_frames_are_copied_once_and_again_where_a_run_replaces_them(parts, tmp_path):
    scene, out = ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml", tmp_path / "out"

    def run(*options):
        subprocess.run([program("DRAPERY", "drapery"), "run", scene, "--set", "resolution=4", "--out", out, *options], check=True,
                       capture_output=True)  # fmt: skip
        (path,) = out.glob("*.abc")
        return path, official(path)

    path, known = run("--frames", "1001-1003")
    recording = parts.recording.Recording(path, None, tmp_path / "live" / "sheet.pc2")
    assert (recording.update(24.0, 1), recording.update(24.0, 1)) == (1001, None)
    path, longer = run("--frames", "1001-1006", "--resume-with-changes")
    assert recording.update(24.0, 1) == 1004
    # Another run, with other frames of the same number.
    path, other = run("--frames", "1001-1006", "--overwrite", "--set", "gravity.acceleration=[0,-3,0]")
    assert recording.update(24.0, 1) == 1001 and recording.last == 1006
    frames = np.fromfile(tmp_path / "live" / "sheet.pc2", np.float32, offset=32).reshape(other["positions"].shape)
    np.testing.assert_array_equal(frames, other["positions"])
    assert np.abs(longer["positions"][-1] - other["positions"][-1]).max() > 1e-3
    with pytest.raises(parts.ogawa.NotReadable, match="no Alembic archive"):
        parts.ogawa.Archive(scene)


@pytest.mark.parametrize("last", ["1002", "1004"])
def test_of_samples_between_frames_the_whole_frames_are_shown(parts, tmp_path, last):
    scene = tmp_path / "scene.toml"
    text = (ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml").read_text()
    scene.write_text(text + "\n[output]\nsamples = 3\nshutter = [-0.25, 0.25]\n")

    def recorded(frames):
        subprocess.run([program("DRAPERY", "drapery"), "run", scene, "--set", "resolution=4", "--out", tmp_path / "out", "--frames", frames,
                        "--resume-with-changes"], check=True, capture_output=True)  # fmt: skip
        (path,) = (tmp_path / "out").glob("*.abc")
        return path, official(path)

    path, known = recorded(f"1001-{last}")
    recording = parts.recording.Recording(path, None, tmp_path / "live.pc2")
    assert recording.update(24.0, 1) == 1001 and recording.last == int(last)
    path, known = recorded("1001-1006")
    assert len(known["positions"]) == 1 + 3 * 5 and recording.update(24.0, 1) == int(last) + 1 and recording.last == 1006
    frames = np.fromfile(recording.target, np.float32, offset=32).reshape(6, -1, 3)
    np.testing.assert_array_equal(frames, known["positions"][::3])
    # Colours are those of the frame that is shown.
    with parts.ogawa.Archive(path) as archive:
        mesh = archive.mesh()
        assert mesh.frames == 6 and np.array_equal(np.frombuffer(mesh.frame(4), np.float32).reshape(-1, 3), known["positions"][12])


# ---- Previews.


def test_a_preview_has_a_run_of_its_own_and_leaves_nothing(looks):
    _, saw = looks
    assert saw["simulated"][0] == "FINISHED" and saw["previewed"] == ["FINISHED"]
    added, note, resolved = saw["preview"]
    assert added == ["Drapery Live", *ADDED] and note == ["Frame 12 of 1 to 12", False]
    assert tomllib.loads(resolved)["solver"]["preset"] == "preview"
    assert saw["untouched"] and saw["left"] and saw["dismissed"] == [["FINISHED"], [], False]


# ---- Colours.


def ramp(shares):
    """The colours of the legend, from its words: blue, cyan, green, yellow, red."""
    stops = np.array([(0.05, 0.12, 0.75), (0.05, 0.62, 0.75), (0.10, 0.62, 0.12), (0.95, 0.75, 0.05), (0.85, 0.06, 0.04)])
    return np.stack([np.interp(shares, np.linspace(0, 1, 5), channel) for channel in stops.T], axis=-1)


def test_strain_is_that_of_the_cache_against_the_mesh_at_rest(looks):
    folder, saw = looks
    result, legend, remarks, strip, _, _ = saw["STRAIN"]
    known = cache(folder, "strip")
    rest = official(folder / "drapery" / "meshes" / "garment_strip.abc")["world_positions"][0]
    place, strain, start = known["world_positions"][-1], {}, 0
    for count in known["face_counts"]:
        corners = known["face_indices"][start : start + count]
        start += count
        for a, b in zip(corners, np.roll(corners, 1)):
            strain[min(a, b), max(a, b)] = np.linalg.norm(place[a] - place[b]) / np.linalg.norm(rest[a] - rest[b]) - 1.0
    at_vertices = np.zeros(len(rest))
    for edge, value in strain.items():
        for vertex in edge:
            at_vertices[vertex] = max(at_vertices[vertex], value)
    # The largest strain of canvas, by `drapery materials`.
    share = at_vertices / 0.061
    within = share < 0.999
    assert result == ["FINISHED"] and legend == ["0.0 %", "1.5 %", "3.0 %", "4.6 %", "6.1 %", "above the limit"]
    np.testing.assert_allclose(np.array(strip)[within, :3], ramp(share[within]), atol=2e-3)
    beyond = np.array(strip)[share > 1.001, :3]
    assert len(beyond) and np.allclose(beyond, (0.75, 0.03, 0.75), atol=1e-6)
    name, vertex, message = remarks[2]
    above = sum(value > 0.061 for value in strain.values())
    assert name == "strip" and at_vertices[vertex] == at_vertices.max()
    assert message == (f'"strip": strain up to {100 * at_vertices.max():.1f} %, limit of the fabric 6.1 %, {above} of {len(strain)} edges '
                       "above it")  # fmt: skip


def test_contact_is_the_distance_to_the_nearest_other_surface(looks):
    folder, saw = looks
    result, legend, remarks, strip, low, high = saw["CONTACT"]
    lower, upper = cache(folder, "low"), cache(folder, "high")
    resolved = tomllib.loads((folder / "drapery" / "out" / "Scene" / "resolved.toml").read_text())
    thickness = {each["name"]: each["thickness"] for each in (*resolved["garment"], *resolved["body"])}
    assert result == ["FINISHED"] and legend[2] == "1: touching" and np.allclose(np.array(strip)[:, :3], ramp(0.0))
    place = upper["world_positions"][-1]
    # Quads are not flat, and Blender may cut them along either diagonal.
    shares, errors = [], []
    for faces in both_cuts(lower["face_counts"], lower["face_indices"]):
        squared, _, _ = igl.point_mesh_squared_distance(place, lower["world_positions"][-1], faces)
        share = np.sqrt(squared) / max(thickness["high"], thickness["low"])
        # The floor is farther away, but it is thicker.
        shares.append(np.minimum(share, place[:, 1] / thickness["floor"]))
        errors.append(np.abs(np.array(high)[:, :3] - ramp(1.0 - np.minimum(shares[-1], 2.0) / 2.0)).max(axis=1))
    assert np.minimum(*errors).max() < 2e-3
    share = np.minimum(*shares)
    assert 0.5 < share.min() < 1.1
    assert remarks[0][0] == "high" and f"{(share < 1.0).sum()} vertices closer than the thickness" in remarks[0][2]
    assert remarks[2] == ["strip", None, '"strip": farther than 2 thicknesses from all bodies and other garments']


def test_colours_follow_the_frame_and_are_taken_off_without_a_trace(looks):
    _, saw = looks
    assert saw["none"] == [["CANCELLED"], [f'"{name}" has no colours: no simulation is shown' for name in ("high", "low", "strip")]]
    assert all("farther than 2 thicknesses" in message for message in saw["other_frame"])
    assert saw["removed"] == ["Drapery Colours", ["Drapery Live", *ADDED, "own"], "own", ""]


def test_a_sheet_that_is_stretched_by_a_tenth_has_that_strain(parts):
    measures = parts.measures
    counts, corners = np.array([4, 3], np.int32).tobytes(), np.array([0, 1, 2, 3, 2, 1, 4], np.int32).tobytes()
    edges = measures.edges_of(counts, corners)
    assert edges.tolist() == [[0, 1], [0, 3], [1, 2], [1, 4], [2, 3], [2, 4]]
    rest = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0.5, 0)], float)
    strains = measures.strains_of(rest * (1.1, 1.0, 1.0), rest, edges)
    np.testing.assert_allclose(strains[[0, 1]], [0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(measures.largest_at_vertices(strains, edges, 5)[[0, 3]], 0.1)
    assert measures.polygons(counts, corners) == [(0, 1, 2, 3), (2, 1, 4)]


def test_thickness_is_that_of_the_rule_or_of_the_thicker_side(parts):
    between = parts.measures.thickness_between
    scene = {"garment": [{"name": "coat", "thickness": "3 mm"}, {"name": "lining", "thickness": 0.001}],
             "body": [{"name": "coat", "thickness": [[1, "1 cm"], [3, 0.02]]}],
             "contact": [{"between": ["lining", "body.coat"], "ignore": True}]}  # fmt: skip
    assert between(scene, "lining", ("garment", "coat"), 1) == 0.003
    assert between(scene, "coat", ("body", "coat"), 2) == pytest.approx(0.015)
    assert between(scene, "lining", ("body", "coat"), 2) is None
    scene["contact"] = [{"between": ["garment.coat", "garment.lining"], "thickness": "0.5 in"}]
    assert between(scene, "lining", ("garment", "coat"), 1) == pytest.approx(0.0127)


# ---- Keyframes.


def test_keyframes_become_numbers_over_time(curves):
    _, saw = curves
    assert saw["planned"][0] == "FINISHED"
    scene = tomllib.loads(saw["scene"])
    # Straight lines keep their keys, cut to the shot; Blender's Z is the solver's Y.
    assert scene["gravity"]["acceleration"] == [[1, [0, -5, 0]], [6, [0, 0, 0]], [10, [0, 0, -0.4]]]
    cloth, _ = scene["garment"]
    # A curve with flat ends: 3 t² - 2 t³.
    t = np.linspace(0.0, 1.0, 10)
    bending = cloth["dihedral_bending"]["stiffness"]
    assert [frame for frame, _ in bending] == list(range(1, 11)) and all(text.endswith(" µN·m") for _, text in bending)
    np.testing.assert_allclose([float(text.split()[0]) for _, text in bending], 20.0 - 18.0 * (3 * t**2 - 2 * t**3), rtol=1e-4)
    rule, of_part = scene["contact"]
    assert of_part == {"between": ["garment.cloth.pocket__", "garment.cloth"], "ignore": True}
    assert [part["name"] for part in cloth["part"]] == ["pocket__"]
    assert rule["between"] == ["garment.cloth", "garment.lining"] and "friction" not in rule
    assert [text for _, text in rule["thickness"]] == 4 * ["2 mm"] + 6 * ["1 mm"]
    # Keys of one value, and curves that are muted, are plain numbers.
    assert scene["body"][0]["friction"] == 0.5 and scene["ether_drag"] == {"rate": 2} and scene["wind"]["velocity"] == [1, 3, -2]
    assert cloth["stretch"] == {"damping_ratio": 0.5} and cloth["pressure"] == {"overpressure": "2 Pa", "open": True}
    assert cloth["pin"][0]["until"] == "0.166666667 s" and scene["output"] == {"format": ["abc", "h5"], "attributes": ["normals", "strain"]}


def test_the_panel_names_what_is_keyframed_and_nothing_else_can_be(curves):
    _, saw = curves
    lines = [line for line in saw["lines"] if line.startswith("Over time: ")]
    assert lines == ["Over time: Gravity (m/s²): 3 keys from frame 1 to 10", 'Over time: "cloth": Bending: 10 keys from frame 1 to 10',
                     'Over time: "cloth": Thickness of the contact with "lining": 10 keys from frame 1 to 10']  # fmt: skip
    assert saw["keyable"] == 4 * ["no"]


@pytest.mark.parametrize("when, words", [
    ("nothing", '"cloth": a rule of contact with "lining" says nothing|choose Ignore, Friction or Thickness'),
    ("no_object", '"cloth": a rule of contact is with no object|choose a garment or a body'),
    ("early", '"cloth": a pin is released at frame -1, before the first frame|choose a later frame'),
    ("driver", '"cloth": Bending is animated by a driver, which is not sampled|bake it to keyframes'),
    ("strip", '"cloth": Bending is animated by a strip of the NLA, which is not sampled|bake it to keyframes'),
])  # fmt: skip
def test_what_cannot_be_sampled_is_named(curves, when, words):
    _, saw = curves
    assert saw[when][0] == "CANCELLED" and any(line.startswith("cloth|None|") and words in line for line in saw[when][1:]), saw[when]
