"""Submission examples of docs/guide/farm, as far as the programs of the schedulers that PyPI has take them.

`make test-full` installs those programs, and DRAPERY_SCHEDULERS names the folder with them.
"""

import os
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from conftest import program
from farm import PATIENCE, assert_same, results
from judges import ROOT

FARM = ROOT / "docs" / "guide" / "farm"
SCENE = ROOT / "sample_assets" / "scenes" / "flag.toml"
FRAMES = "0-8"

pytestmark = pytest.mark.full

# Takes the place of the cuebot: prints what would be sent to it.
SENT = """
import runpy, sys
import opencue.api
opencue.api.launchSpecAndWait = lambda specification: print(specification) or [None]
sys.path.insert(0, sys.argv[1].rsplit("/", 1)[0])
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def programs():
    folder = os.environ.get("DRAPERY_SCHEDULERS")
    if not folder:
        pytest.skip("DRAPERY_SCHEDULERS is not set")
    os.environ["PATH"] = f"{Path(program('DRAPERY', 'drapery')).parent}:{os.environ['PATH']}"
    os.environ.pop("DRAPERY_PROGRESS", None)
    return Path(folder)


@pytest.fixture(scope="module")
def whole(run_scene):
    return results(run_scene(str(SCENE), FRAMES))


def run(*command, folder, code=0):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == code, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


def test_open_job_description_checks_and_runs_the_template(programs, whole, tmp_path):
    run(programs / "openjd", "check", FARM / "openjd.yaml", folder=tmp_path)
    job = [f"Scene={SCENE}", f"Frames={FRAMES}", f"Out={tmp_path / 'out'}"]
    said = run(programs / "openjd", "run", FARM / "openjd.yaml", *(word for value in job for word in ("--job-param", value)),
               folder=tmp_path)
    assert re.search(r"openjd_progress: 100$", said, re.MULTILINE) and "Session ended successfully" in said
    assert_same(tmp_path / "out", whole)


def test_opencue_gets_one_frame_whose_command_is_the_shot(programs, whole, tmp_path):
    out = tmp_path / "out"
    sent = run(programs / "python", "-c", SENT, FARM / "opencue_job.py", "show", "sh042", SCENE, FRAMES, out, folder=tmp_path)
    # The type of document names a server.
    layer, = ElementTree.fromstring(re.sub(r"<!DOCTYPE.*?>", "", sent)).iter("layer")
    assert (layer.findtext("range"), layer.findtext("chunk")) == (FRAMES, "9")
    run("bash", "-c", layer.findtext("cmd"), folder=tmp_path)
    assert_same(out, whole)
