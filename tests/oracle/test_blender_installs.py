"""The add-on is installed, updated and removed with a saved file open, in one session of Blender: the module of 5.0, and Debian's 3.4.

Blender lends an add-on no data of the open file while it is registered, and keeps what a registration leaves that fails halfway.
"""

import subprocess
import zipfile

import pytest

from blender_session import blender_does, needs_blender, package
from conftest import program
from judges import HERE

# What a whole add-on shows. In a Blender without a window its timer waits for one, as the tests do.
WHOLE = {"enabled": True, "timer": [True], "run": "done", "role": "GARMENT", "handlers": 1}


def version(archive, name, changes):
    """The zip with other words in some of its files."""
    path = archive.with_name(name)
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(path, "w") as new:
        for file in old.namelist():
            text = old.read(file).decode()
            for of, before, after in changes:
                if file.endswith(of):
                    assert before in text
                    text = text.replace(before, after)
            new.writestr(file, text)
    return path


@pytest.fixture(scope="module", params=["module", "debian"])
def seen(request, tmp_path_factory):
    needs_blender(request.param)
    folder, drapery = tmp_path_factory.mktemp("installs"), program("DRAPERY", "drapery")
    _, good = package("--without-solver", folder)
    newer = version(good, "newer.zip", [("manifest.toml", 'version = "0.1.0"', 'version = "0.1.1"'), ("fabrics.py", "Light Silk", "Silk")])
    # Its last panel is none: all that comes before is registered by then.
    broken = version(good, "broken.zip", [("panels.py", "VIEW3D_PT_drapery_colours)", "Panel)")])
    scene = HERE.parent.parent / "sample_assets" / "scenes" / "hanging_sheet.toml"
    run = folder / "drapery" / "open" / "Scene" / "out" / "Scene"
    subprocess.run([drapery, "run", scene, "--frames", "1001-1002", "--set", "resolution=4", "--out", run], check=True, capture_output=True)
    said, answer = blender_does(request.param, "blender_installs.py", folder, "answer.json", folder, good, newer, broken, drapery)
    assert answer["version"][:2] == [5, 0] or request.param == "debian"
    # What unregisters badly, or an object that nobody closes, says so here and nowhere else; the broken version is meant to.
    assert said.count("Traceback") <= said.count("missing bl_rna"), said[-4000:]
    assert "Exception in module unregister" not in said and "Exception ignored" not in said, said[-4000:]
    return answer


@pytest.mark.parametrize("when", ["first", "again", "newer", "mended", "after_removal"])
def test_the_add_on_is_installed_with_a_saved_file_open(seen, when):
    assert seen[when] == ["FINISHED"]


@pytest.mark.parametrize("when, word", [("lives", "Light Silk"), ("lives_again", "Light Silk"), ("lives_enabled", "Light Silk"),
                                        ("lives_newer", "Silk"), ("lives_opened", "Silk"), ("lives_mended", "Light Silk"),
                                        ("lives_after_removal", "Silk")])  # fmt: skip
def test_it_finds_the_run_of_the_open_file_and_keeps_what_was_set(seen, when, word):
    assert seen[when] == WHOLE | {"word": word}


def test_a_registration_that_fails_halfway_takes_itself_back(seen):
    assert seen["broken"] != ["FINISHED"] and seen["left_broken"] == []


def test_disabling_and_removing_leave_nothing(seen):
    assert seen["disabled"] == [] and seen["left_removed"] == [] and seen["modules"] == []
