"""Submission examples of docs/guide/farm, as far as the programs of the schedulers that PyPI has take them; those for Deadline 10 and
Tractor, of which no program is public, are read by their formats, and their commands are run in the order that they ask for.

`make test-full` installs those programs, and DRAPERY_SCHEDULERS names the folder with them.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from conftest import program
from farm import PATIENCE, assert_same, manifest, results
from judges import ROOT

FARM = ROOT / "docs" / "guide" / "farm"
SCENE = ROOT / "sample_assets" / "scenes" / "flag.toml"
FRAMES = "0-8"

pytestmark = pytest.mark.full

# Keys of job files that the manual of Deadline 10 has, of those that could be of use here.
JOB_INFO = {"Plugin", "Name", "Frames", "ChunkSize", "ConcurrentTasks", "Sequential", "MachineLimit", "Interruptible", "Pool", "Group",
            "Priority", "OverrideTaskFailureDetection", "FailureDetectionTaskErrors", "OverrideJobFailureDetection",
            "FailureDetectionJobErrors", "EnvironmentKeyValue0", "OutputDirectory0"}
# Those of its plugin CommandLine.
PLUGIN_INFO = {"Executable", "Arguments", "StartupDirectory", "Shell", "ShellExecute", "SingleFramesOnly"}

# A job of Tractor is a script in Tcl. This reads one: it prints the title of each task and its codes of another attempt, then the words of its
# command, one a line and an empty one behind. Operators refuse options that Tractor does not have.
TRACTOR = """
proc check {known options} {
    foreach {name value} $options { if {$name ni $known} { error "no option $name" } }
}
proc Job {args} {
    check {-title -subtasks -serialsubtasks -service -tags -envkey -priority -atleast -atmost -metadata -comment} $args
    if {![dict get $args -serialsubtasks]} { error "tasks run at the same time" }
    eval [dict get $args -subtasks]
}
proc Task {title args} {
    check {-cmds -subtasks -serialsubtasks -service -id -metadata} $args
    set ::title $title
    eval [dict get $args -cmds]
}
proc RemoteCmd {words args} {
    check {-service -tags -id -refersto -expand -atleast -atmost -minrunsecs -maxrunsecs -samehost -envkey -retryrc -when -resumewhile
        -resumepin -metadata} $args
    puts "$::title [dict get $args -retryrc]"
    foreach word $words { puts $word }
    puts ""
}
source [lindex $argv 0]
"""

# Takes the place of Deadline Cloud: prints the job that its client would send. The client checks it by the model of the service.
CLOUD = """
from types import SimpleNamespace
import botocore.endpoint
from deadline.client.cli import main

ANSWERS = {
    "GetQueue": {"queueId": "queue", "displayName": "shots", "farmId": "farm", "status": "IDLE", "defaultBudgetAction": "NONE"},
    "ListQueueEnvironments": {"environments": []},
    "CreateJob": {"jobId": "job"},
    "GetJob": {"jobId": "job", "lifecycleStatus": "CREATE_COMPLETE", "lifecycleStatusMessage": ""},
}

def answer(self, operation, request):
    if operation.name == "CreateJob":
        print(request["body"].decode())
    return SimpleNamespace(status_code=200), ANSWERS.get(operation.name, {}) | {"ResponseMetadata": {}}

botocore.endpoint.Endpoint.make_request = answer
main()
"""

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


def run(*command, folder, code=0, environment=None):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=PATIENCE,
                          env=os.environ | (environment or {}))
    assert done.returncode == code, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout if code == 0 else done.stderr


def first_frames(out):
    """First frame of each attempt."""
    return [attempt["first_frame"] for attempt in manifest(out)["attempts"]]


@pytest.mark.parametrize(("chunk", "starts"), [(None, [0]), (3, [0, 3, 6])])
def test_open_job_description_checks_and_runs_the_template(programs, whole, tmp_path, chunk, starts):
    template = FARM / "openjd" / "template.yaml"
    run(programs / "openjd", "check", template, folder=tmp_path)
    job = [f"Scene={SCENE}", f"Frames={FRAMES}", f"Out={tmp_path / 'out'}"] + ([f"ChunkFrames={chunk}"] if chunk else [])
    said = run(programs / "openjd", "run", template, *(word for value in job for word in ("--job-param", value)), folder=tmp_path)
    assert re.search(r"openjd_progress: 100$", said, re.MULTILINE) and "Session ended successfully" in said
    assert first_frames(tmp_path / "out") == starts
    assert_same(tmp_path / "out", whole)


def test_the_client_of_deadline_cloud_sends_the_bundle_for_one_worker(programs, tmp_path):
    comment = (FARM / "openjd" / "template.yaml").read_text()
    line = re.search(r"^#   deadline (bundle submit openjd .*)$", comment, re.MULTILINE)[1]
    account = {"HOME": str(tmp_path), "AWS_ACCESS_KEY_ID": "none", "AWS_SECRET_ACCESS_KEY": "none", "AWS_DEFAULT_REGION": "us-west-2",
               "DEADLINE_CLOUD_TELEMETRY_OPT_OUT": "true"}
    sent = run(programs / "python", "-c", CLOUD, *shlex.split(line), "--yes", "--farm-id", "farm-" + "0" * 32, "--queue-id",
               "queue-" + "0" * 32, folder=FARM, environment=account)
    job = json.loads(re.search(r"^\{.*\}$", sent, re.MULTILINE)[0])
    assert (job["maxWorkerCount"], job["maxRetriesPerTask"]) == (1, 20)
    assert job["parameters"].keys() == {"Scene", "Out"} and "attachments" not in job
    assert job["template"] == comment


def chunks_of_deadline(job):
    """First and last frame of the tasks of a job of Deadline."""
    first, last = map(int, job["Frames"].split("-"))
    each = int(job["ChunkSize"])
    return [(start, min(start + each - 1, last)) for start in range(first, last + 1, each)]


def test_tasks_of_deadline_follow_each_other_and_each_goes_on(programs, run_scene, tmp_path):
    job, plugin = (dict(line.split("=", 1) for line in (FARM / "deadline" / f"{name}_info.txt").read_text().splitlines())
                   for name in ("job", "plugin"))
    assert job.keys() <= JOB_INFO and plugin.keys() <= PLUGIN_INFO
    assert (job["Plugin"], job["Sequential"], job["MachineLimit"]) == ("CommandLine", "true", "1")
    shutil.copy(ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml", tmp_path / "scene.toml")
    tasks = chunks_of_deadline(job)
    for start, end in tasks:
        words = plugin["Arguments"].replace("<STARTFRAME>", str(start)).replace("<ENDFRAME>", str(end))
        said = run(plugin["Executable"], *shlex.split(words), "--set", "resolution=8", folder=tmp_path)
        assert re.search(r"^Progress: 100%$", said, re.MULTILINE)
    out = tmp_path / "out" / "shot_042"
    assert first_frames(out) == [start for start, _ in tasks] and len(tasks) == 10
    assert_same(out, results(run_scene(str(tmp_path / "scene.toml"), job["Frames"], resolution=8)))


def test_tasks_of_tractor_follow_each_other_and_each_goes_on(programs, whole, tmp_path):
    out, job = tmp_path / "the out", tmp_path / "shot.alf"
    chunks = ["bash", FARM / "tractor_chunks.sh", "shot", "4", out, SCENE, FRAMES]
    job.write_text(run(*chunks, folder=tmp_path))
    (tmp_path / "read.tcl").write_text(TRACTOR)
    tasks = run("tclsh", tmp_path / "read.tcl", job, folder=tmp_path).split("\n\n")[:-1]
    for task in tasks:
        title, *words = task.split("\n")
        assert re.fullmatch(r"\d-\d 69 70 71 75", title)
        said = run(*words, folder=tmp_path)
        assert re.search(r"^TR_PROGRESS 100$", said, re.MULTILINE)
    assert first_frames(out) == [0, 4, 8]
    assert_same(out, whole)
    assert "cannot be passed on" in run(*chunks, "--set", "a={", folder=tmp_path, code=2)
    assert "FRAMES is a number" in run(*chunks[:3], "none", *chunks[4:], folder=tmp_path, code=2)


def test_opencue_gets_one_frame_whose_command_is_the_shot(programs, whole, tmp_path):
    out = tmp_path / "out"
    sent = run(programs / "python", "-c", SENT, FARM / "opencue_job.py", "show", "sh042", SCENE, FRAMES, out, folder=tmp_path)
    # The type of document names a server.
    layer, = ElementTree.fromstring(re.sub(r"<!DOCTYPE.*?>", "", sent)).iter("layer")
    assert (layer.findtext("range"), layer.findtext("chunk")) == (FRAMES, "9")
    run("bash", "-c", layer.findtext("cmd"), folder=tmp_path)
    assert_same(out, whole)
