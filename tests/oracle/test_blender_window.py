"""The add-on in a Blender with a window: Debian's, drawn into a frame buffer (Xvfb). Every button is pressed, every panel drawn.

Debian's Blender is 3.4, and built without Alembic: another Blender, the module that the judges use, writes the meshes, as the
preference for such builds says, and Load has to say why it cannot. Loading is tested in test_blender_addon.py.
"""

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from blender_session import session
from conftest import program


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    for needed in ("blender", "xvfb-run"):
        if shutil.which(needed) is None:
            pytest.skip(f"no {needed}; `make setup` installs it on Debian")
    folder = tmp_path_factory.mktemp("window")
    said = session(folder, program("DRAPERY", "drapery"))
    assert (folder / "answer.json").exists(), said[-4000:]
    # A panel that fails while it is drawn says so here and nowhere else.
    assert "Traceback" not in said and "rna_uiItem" not in said, said[-4000:]
    answer = json.loads((folder / "answer.json").read_text())
    assert "failed" not in answer, answer["failed"]
    return folder, answer


def presses(answer, button):
    return [press[1:] for press in answer["presses"] if press[0].endswith(f".drapery_{button}")]


def test_every_button_was_pressed(seen):
    _, answer = seen
    buttons = {name.split("_OT_drapery_")[1] for name in answer["operators"]}
    assert buttons == {press[0].split(".drapery_")[1] for press in answer["presses"]}


def test_what_can_be_pressed_does_its_work(seen):
    _, answer = seen
    # Nothing is marked in the first one.
    first = answer["presses"].pop(0)
    assert first[:3] == ["scene.drapery_check", True, ["CANCELLED"]]
    assert any("No object is marked as a garment" in message for message in first[3])
    for button in ("mark", "pin_add", "seam_add", "map_add", "contact_add", "elastic_add", "belt_add", "remove", "check", "plan", "write", "simulate", "show", "cancel", "continue", "preview",
                   "dismiss"):
        assert all(allowed and result == ["FINISHED"] for allowed, result, _, _ in presses(answer, button)), button
    assert answer["waited"][0] is False and answer["waited"][1] != []
    assert answer["shown"] == ["skirt", 1004, [5]]
    assert answer["cancelled"] in ("stopped", "done") and answer["done"] == "done"


def test_warnings_of_the_run_are_in_the_panel(seen):
    _, answer = seen
    assert answer["warnings"] == ['frame 1007, time 0.25 s: garment "skirt", vertex 5: the solve diverged']


def test_a_window_follows_runs_and_previews_by_itself(seen):
    _, answer = seen
    note, modifiers = answer["live"]
    # The playhead went to the newest frame.
    assert note == ["Frame 1024 of 1001 to 1024", False] and "Drapery Live" in modifiers
    note, modifiers = answer["previewed"]
    assert note[1] is False and "Drapery Live" in modifiers and answer["dismissed"] == []


def test_colours_need_numpy_and_say_so(seen):
    # Debian's package does not bring it; colours are tested in test_blender_live.py.
    _, answer = seen
    (message,) = answer["colours"]
    assert message.startswith('"skirt": strain up to') or message == '"skirt" has no colours: this Blender has no numpy'


def test_every_fabric_has_a_picture(seen):
    _, answer = seen
    assert len(set(answer["icons"])) == 10 and 0 not in answer["icons"]


def test_a_blender_without_alembic_says_that_it_loads_nothing(seen):
    _, answer = seen
    (load,) = presses(answer, "load")
    assert load[1] == ["CANCELLED"] and "built without Alembic" in load[2][0]
    assert presses(answer, "unload")[0][0] is False


def test_disabling_leaves_nothing(seen):
    _, answer = seen
    assert answer["left"] == []


def test_every_panel_is_drawn_to_its_end(seen):
    _, answer = seen
    assert set(answer["drawn"]) == set(answer["panels"])


@pytest.mark.parametrize("before, after", [("empty", "marked"), ("marked", "planned"), ("planned", "problem"), ("problem", "running"),
                                           ("running", "done"), ("done", "live"), ("live", "previewed"), ("previewed", "warned")])  # fmt: skip
def test_the_panel_shows_what_happens(seen, before, after):
    folder, _ = seen
    pictures = [np.asarray(Image.open(folder / f"{name}.png").convert("L"), float) for name in (before, after)]
    # The sidebar is at the right of the 3D view; a few per cent of it are letters that change.
    changed = np.abs(pictures[1] - pictures[0]) > 40
    assert changed.mean() > 0.002, f"{before} and {after} look the same"
