"""The add-on with scenes as artists have them, in the module of Blender 5.0 and in Debian's 3.4, each act in a session of its own."""

import tomllib

import numpy as np
import pytest

from blender_session import blender_does, exporter_in, needs_blender, package
from conftest import program
from judges import official, z_up

# Of blender_artist.py: cells of a panel up and along, and their size.
ROWS, COLUMNS, CELL = 8, 6, 0.025
# What `drapery materials` says of shirt cotton: the distance that sewn layers keep [m].
THICKNESS = 0.318e-3


@pytest.fixture(scope="module", params=["module", "debian"])
def act(request, tmp_path_factory):
    """Does an act of blender_artist.py, once; its folder and its answer."""
    needs_blender(request.param)
    drapery, seen = program("DRAPERY", "drapery"), {}

    def does(name):
        if name not in seen:
            seen[name] = session(request.param, name, tmp_path_factory.mktemp(name), drapery)
        return seen[name]

    return does


def session(blender, name, folder, drapery):
    _, archive = package("--without-solver", folder)
    exporter = exporter_in(folder) if blender == "debian" else "none"
    said, answer = blender_does(blender, "blender_artist.py", folder, f"{name}.json", name, folder, archive, drapery, exporter)
    assert "Traceback" not in said, said[-4000:]
    assert answer["version"][:2] == [5, 0] or blender == "debian"
    return folder, answer


def column(i):
    """Numbers of a panel's vertices on a line upwards, from below."""
    return [i + (COLUMNS + 1) * j for j in range(ROWS + 1)]


def positions(folder, name):
    return official(folder / "drapery" / "out" / "Scene" / f"{name}.abc")["world_positions"]


def test_sewn_panels_close_evenly_between_their_frames(act):
    folder, saw = act("seams")
    finished, warning = saw["simulated"]
    assert finished == "FINISHED" and "it never opens: `opens` is at 4 s, after the last frame" in warning
    front, back = positions(folder, "front"), positions(folder, "back____")
    # The other panel counts its vertices from the other end: its left edge, from below, as it was built.
    numbers = [(COLUMNS + 1) * (ROWS + 1) - 1 - v for v in column(0)]
    gaps = np.linalg.norm(front[:, column(COLUMNS)] - back[:, numbers], axis=-1)
    # From 5 cm at frame 3 to the thickness at frame 13. They have weight, and lag while they are drawn.
    frames = np.arange(1, 21)
    closing = 0.05 + (THICKNESS - 0.05) * np.clip((frames - 3) / 10, 0.0, 1.0)
    np.testing.assert_allclose(gaps[:2], 0.05, atol=1e-5)
    np.testing.assert_allclose(gaps, closing[:, None].repeat(ROWS + 1, 1), atol=0.01)
    assert gaps[-1].max() < 1e-3
    # Nothing else draws them: unsewn edges are as far apart as the panels are wide.
    assert np.linalg.norm(front[-1, column(0)] - back[-1, numbers], axis=-1).min() > 0.8 * COLUMNS * CELL


def test_two_groups_of_one_garment_are_sewn(act):
    folder, _ = act("seams")
    tube = positions(folder, "tube")
    gaps = np.linalg.norm(tube[:, [25 * j for j in range(5)]] - tube[:, [25 * j + 24 for j in range(5)]], axis=-1)
    # The chord of 0.4 rad at a radius of 10 cm; the rims bend the tube when they close.
    np.testing.assert_allclose(gaps[0], 0.2 * np.sin(0.2), atol=1e-5)
    assert gaps[-1].max() < 2e-3
    scene = tomllib.loads((folder / "drapery" / "scene.toml").read_text())
    to_panel, to_itself = scene["seam"]
    assert (to_panel["start"], to_panel["closed"]) == ("0.0833333333 s", "0.5 s") and "pairing" not in to_panel
    assert (to_panel["opens"], to_panel["opened"]) == ("4 s", "5 s") and "opens" not in to_itself
    assert to_itself["pairing"] == "nearest" and to_itself["strength"] == "250 N/m"
    assert to_itself["from"]["garment"] == to_itself["to"]["garment"] == "tube"


def test_seams_are_undone_saved_and_copied(act):
    _, saw = act("seams")
    sewn = ["right", "bäck", "left"]
    assert saw["added"] == saw["redone"] == [sewn] and saw["undone"] == [] and saw["frames"] == [1, 25]
    assert saw["removed"] == [["begin", "tube", "end"]]
    # The garment was renamed since; groups of a tube lead to the tube, also of its copies.
    assert saw["opened"] == [[["right", 'back "ü"', "left"]], [["begin", "tube", "end"]]]
    assert saw["copies"] == [[["right", 'back "ü".001', "left"]], [["begin", "tube.001", "end"]]]
    assert saw["copy"] == [["right", 'back "ü"', "left"]] and saw["copied_alone"] == [["begin", "tube.002", "end"]]


@pytest.mark.parametrize(
    "when, words",
    [
        ("no_garment", 'front|None|None|None|"front": the seam of its group "right" leads to no garment|choose the one'),
        ("not_marked", 'the seam of its group "right" leads to "other", which is not a garment of this scene|mark it'),
        ("itself", 'the seam of its group "right" leads to the same group|choose another group'),
        ("no_group", 'the seam of its group "right" leads to no vertex group of "front"'),
        ("no_own_group", '"front": a seam has no vertex group|choose one, or remove the seam'),
        ("times", 'the seam of its group "right" is closed at frame 8, before it starts to close at frame 9'),
        ("opening", 'the seam of its group "right" is open at frame 8, before it starts to open at frame 9'),
        ("zip", 'the seam of its group "right" is a zip, and its pairs have no order|choose Pairs: Along the Edges'),
        ("twice", '"front": the seam of its group "right" to "left" of "bäck" is there twice|remove one'),
        ("missing", 'b_ck|None|None|None|"bäck" has no vertex group "cuff", which a seam sews'),
        ("light", '"bäck": no vertex of vertex group "cuff" is above one half, so that a seam sews nothing'),
        ("counts", 'the seam of "right" of "front" to "left" of "other" has 9 vertices on one side, 7 on the other|give both the same'),
        ("pieces", 'other|None|vertex|5|"other": vertex group "pieces", which a seam sews along the edges, is no single line of edges: '
                   "it is in 2 pieces"),
        ("crossing", "other|None|vertex|1|"), ("crossing", "vertex 1 has 3 neighbours in it|keep one line of vertices in it"),
        ("shared", 'other|None|vertex|0|"other": vertex 0 is in both groups of a seam, "bottom" and "left"'),
        ("ring", 'the seam of "square" of "other" to "four" of "other" has a ring on one side, and a line with two ends on the other'),
        ("same", 'the seam of "four" of "other" to "also four" of "other" has the same vertices on both sides'),
        ("deleted", 'the seam of its group "right" leads to "bäck", which is not a garment of this scene'),
        ("removed", 'the seam of its group "right" leads to no garment'),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_seam_is_said_with_names(act, when, words):
    _, saw = act("bad_seams")
    assert saw[when][0] == "CANCELLED" and any(words in line for line in saw[when][1:]), saw[when]


def test_a_band_a_belt_and_a_patch_on_a_surface_are_in_the_scene_and_simulated(act):
    folder, saw = act("joins")
    assert saw["simulated"] == ["FINISHED"], saw["simulated"]
    scene = tomllib.loads(saw["scene"])
    tube, patch = (next(garment for garment in scene["garment"] if garment["name"] == name) for name in ("tube", "patch"))
    assert [tube["elastic"][0]["rest_scale"][end] for end in (0, -1)] == [[1, 1], [12, 0.8]] and tube["elastic"][0]["stiffness"] == "12 N" and tube["rest_scale"] == 0.95
    [seam] = scene["seam"]
    assert seam["to"] == {"garment": "tube"} and seam["pairing"] == "surface" and seam["keep_gap"] and seam["break_force"] == "3 N"
    belt = next(body for body in scene["body"] if body["name"] == "girdle")["belt"]
    assert belt["around"] == "column" and np.allclose(belt["at"], [1, 1, 0], atol=1e-6) and np.allclose(belt["axis"], [0, 1, 0])
    # The column is a ball of 7 cm: the belt is a ring around its equator.
    ring = positions(folder, "girdle")[0]
    assert np.hypot(ring[:, 0] - 1, ring[:, 2]).min() == pytest.approx(0.13, rel=0.03) and np.ptp(ring[:, 1]) == pytest.approx(0.02, abs=1e-5)
    x = positions(folder, "tube")
    top = np.flatnonzero(np.abs(x[0][:, 1] - x[0][:, 1].max()) < 1e-6)
    around = [np.linalg.norm(x[frame][top] - x[frame][top].mean(axis=0), axis=1).mean() for frame in (0, -1)]
    assert around[1] < 0.93 * around[0], around
    for when, words in (("no_group", '"tube": an elastic band has no vertex group|choose one'), ("no_place", '"column": a belt has no place|choose an empty'),
                        ("own_surface", "leads to the surface of its own garment|choose another garment")):  # fmt: skip
        assert saw[when][0] == "CANCELLED" and any(words in line for line in saw[when][1:]), saw[when]


def test_nearest_takes_groups_of_different_size(act):
    _, saw = act("bad_seams")
    assert saw["counts_nearest"] == "FINISHED"


def test_darts_and_rings_are_sewn_in_order(act):
    folder, saw = act("darts")
    assert saw["simulated"] == ["FINISHED"]
    rings, dart = sorted(tomllib.loads(saw["scene"])["seam"], key=lambda seam: seam["from"]["garment"])
    # Both edges from the corner, which is sewn to nothing; in 5.0 and 3.4, whichever end they begin at.
    row = COLUMNS + 1
    pairs = set(zip(dart["from"]["vertices"], dart["to"]["vertices"]))
    assert pairs == {(k * row, k) for k in range(1, row)}
    # A zip begins at its lower end.
    assert dart["zip"] and (np.diff(z_up(positions(folder, "square"))[0][dart["from"]["vertices"]][:, 2]) > 0).all()
    # The upper tube counts from another place: each vertex is sewn to the one above it.
    assert set(zip(rings["from"]["vertices"], rings["to"]["vertices"])) == {(80 + i, (i - 5) % 20) for i in range(20)}
    low, high = positions(folder, "low"), positions(folder, "high")
    gaps = np.linalg.norm(low[:, 80:100] - high[:, [(i - 5) % 20 for i in range(20)]], axis=-1)
    np.testing.assert_allclose(gaps[0], 0.1, atol=1e-5)
    assert gaps[-1].max() < 2e-3


def test_odd_objects_are_simulated_where_they_are_and_shown_where_their_caches_are(act):
    # Mirrored, below a scaled parent, stretched, of one mesh, with shape keys, hidden, in Edit Mode; frames below zero, 29.97 a second, every
    # second one played, in a folder of odd letters.
    _, saw = act("odd_scene")
    assert saw["simulated"] == ["FINISHED"] and saw["mode"] == "EDIT_MESH"
    assert sorted(saw["starts"]) == sorted(["a_b__c______", "child", "plain", "twin", "keyed", "hidden", "edited"])
    for name, start in saw["starts"].items():
        cache = z_up(official(f"{saw['run']}/{name}.abc")["world_positions"])
        assert len(cache) == 6
        np.testing.assert_allclose(cache[0], start, atol=1e-6, err_msg=name)
        if "shown" in saw:
            np.testing.assert_allclose(saw["shown"][name], cache, atol=1e-6, err_msg=name)
    assert saw.get("loaded", ["FINISHED"]) == ["FINISHED"]
    # The body, which is inside out by its scale and hidden from the middle on, holds the cloth above it; others fall by g t² / 2.
    time = 5 * 1001 / 30000
    plain, hidden = (z_up(official(f"{saw['run']}/{name}.abc")["world_positions"]) for name in ("plain", "hidden"))
    fallen = hidden[0, 0, 2] - hidden[-1, 0, 2]
    assert abs(fallen - 0.5 * 9.81 * time**2) < 0.1 * fallen
    assert plain[0, 0, 2] - plain[-1, 0, 2] < 0.9 * fallen


@pytest.mark.parametrize("hidden", ["Collection.hide_viewport", "Collection.hide_render", "Collection.hide_select",
                                    "LayerCollection.hide_viewport", "Object.hide_render", "Object.hide_viewport"])  # fmt: skip
def test_hidden_bodies_are_collided_with(act, hidden):
    _, saw = act("hidden_bodies")
    assert saw[hidden] == ["FINISHED"]


def test_an_excluded_body_is_named_with_what_to_do(act):
    _, saw = act("hidden_bodies")
    result, said = saw["LayerCollection.exclude"]
    assert result == "CANCELLED" and "in one that is excluded|include its collection (the check box in the Outliner)" in said


def test_mirrors_and_stretched_time_are_named(act):
    _, saw = act("warned")
    result, said = saw["mirror"]
    assert result == "FINISHED" and '"cloth": Mirror comes after the simulated mesh, so that one half is cloth' in said
    assert saw["mirror_too"] == ["FINISHED"]
    assert saw["stretched"][0] == "CANCELLED" and "Time Stretching is 100 to 200" in saw["stretched"][1]


def test_shear_is_named_with_its_frame(act):
    _, saw = act("warned")
    result, said = saw["sheared"]
    assert result == "CANCELLED" and said.startswith('below|3|None|None|"below" is sheared at frame 3, by a parent')


def test_a_cup_is_a_body_and_a_scene_in_a_wrong_unit_is_refused(act):
    _, saw = act("warned")
    assert saw["cup"][0] == "FINISHED"
    assert saw["giant"][0] == "CANCELLED" and "looks like centimetres" in saw["giant"][1]


def test_what_is_set_on_an_override_is_kept(act):
    _, saw = act("overrides")
    kept = ["BODY", "GARMENT", "canvas", [["top", None], ["left", "body"]], [["left", "cloth", "right"]], 123.0, "top"]
    assert saw["kept"] == [kept] * 3
    assert "comes from the linked file; remove it there" in saw["linked_row"] and saw["simulated"][0] == "FINISHED"


def test_a_file_or_scene_with_another_name_says_where_its_simulation_goes_on(act):
    _, saw = act("names")
    assert saw["undone"] == "cotton_shirting" and saw["runs"]
    for when, back in (("saved_as", "saved_back"), ("renamed", "named_back")):
        can_cancel, state, (line,) = saw[when]
        assert not can_cancel and state is None and "shot/Scene/out/Scene continues. Its scene or folder has another name now" in line
        assert saw[back] == [True, "running", []]
    assert saw["cancelled"] == [["FINISHED"], "stopped"]
