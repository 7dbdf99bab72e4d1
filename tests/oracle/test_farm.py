"""Promises of docs/guide/farm.md to schedulers: scripts, signals, exit codes and the lines that they parse.

The Slurm script runs against a stand-in (slurm_stand_in.py) here, and against Slurm in test_slurm.py.
"""

import json
import os
import re
import resource
import signal
import subprocess
import time

import pytest

from conftest import program
from farm import PATIENCE
from judges import ROOT
from slurm_stand_in import Slurm, frame_of, make_foreign, wait_for_frame

FARM = ROOT / "docs" / "guide" / "farm"
SCENE = ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml"
FIRST, LAST = 1001, 1030
RESOLUTION, SLOW = 30, 50
ARGUMENTS = [str(SCENE), "--frames", f"{FIRST}-{LAST}", "--set", f"resolution={RESOLUTION}"]
PLAIN = FARM / "plain.sh"


def drapery(*arguments, **options):
    """Runs the command; standard output, standard error and exit code."""
    command = [program("DRAPERY", "drapery"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PATIENCE, **options)


@pytest.fixture(autouse=True)
def the_scripts_find_the_program(monkeypatch):
    monkeypatch.setenv("DRAPERY", program("DRAPERY", "drapery"))
    monkeypatch.delenv("DRAPERY_PROGRESS", raising=False)


@pytest.fixture(scope="module")
def whole(run_scene):
    """Folder of the run that nobody disturbs."""
    return run_scene("sample_assets/scenes/hanging_sheet.toml", f"{FIRST}-{LAST}", resolution=RESOLUTION)


def assert_same(out, whole):
    names = ["sheet.abc", "sheet.h5", f"checkpoints/frame_{LAST:05}.h5"]
    for name in names:
        assert (out / name).read_bytes() == (whole / name).read_bytes(), f"{name} differs from the uninterrupted run"


def attempts(out):
    return json.loads((out / "manifest.json").read_text())["attempts"]


def start_plain(out, *arguments, shot=ARGUMENTS):
    return subprocess.Popen(["bash", str(PLAIN), str(out), *shot, "--progress", "none", *arguments],
                            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)


def test_the_plain_script_starts_attempts_until_the_shot_is_done(whole, tmp_path):
    # A fast machine needs a shorter limit to be stopped twice.
    for limit in ("0.3s", "0.1s", "0.03s"):
        out = tmp_path / limit
        assert start_plain(out, "--max-wall", limit).wait(PATIENCE) == 0
        ends = [attempt["end"] for attempt in attempts(out)]
        assert ends[-1] == "done" and set(ends[:-1]) == {"max-wall"}, ends
        assert_same(out, whole)
        if len(ends) > 2:
            return
    pytest.fail("no limit stopped the run twice")


def test_the_plain_script_passes_signals_on_and_ends_when_it_is_told(run_scene, tmp_path):
    # Slow enough that the file `stop`, which is looked for once a second, is found before the last frame.
    whole = run_scene("sample_assets/scenes/hanging_sheet.toml", f"{FIRST}-{LAST}", resolution=SLOW)
    out, shot = tmp_path / "out", [*ARGUMENTS[:-1], f"resolution={SLOW}"]
    script = start_plain(out, shot=shot)
    wait_for_frame(out, FIRST + 2, script)
    script.send_signal(signal.SIGTERM)
    assert script.wait(PATIENCE) == 75
    script = start_plain(out, shot=shot)
    wait_for_frame(out, frame_of(out) + 2, script)
    assert drapery("stop", out).returncode == 0
    code = script.wait(PATIENCE)
    assert [attempt["end"] for attempt in attempts(out)] == ["signal TERM", "control/stop"]
    assert code == 75
    assert start_plain(out, shot=shot).wait(PATIENCE) == 0
    assert_same(out, whole)


def test_a_signal_to_the_run_alone_is_followed_by_the_next_attempt(whole, tmp_path):
    out = tmp_path / "out"
    script = start_plain(out)
    wait_for_frame(out, FIRST + 5, script)
    os.kill(json.loads((out / "lock.json").read_text())["pid"], signal.SIGUSR1)
    assert script.wait(PATIENCE) == 0
    assert [attempt["end"] for attempt in attempts(out)] == ["signal USR1", "done"]
    assert_same(out, whole)


def test_the_plain_script_takes_a_silent_lock_over_and_no_other(whole, tmp_path):
    out = tmp_path / "out"
    script = start_plain(out, "--checkpoint-every", "5f")
    wait_for_frame(out, FIRST + 12, script)
    os.killpg(script.pid, signal.SIGKILL)
    script.wait()
    make_foreign(out, silent_for=20)
    assert start_plain(out).wait(PATIENCE) == 73
    make_foreign(out, silent_for=400)
    assert start_plain(out).wait(PATIENCE) == 0
    assert attempts(out)[-1]["first_frame"] > FIRST, "it began at the first frame again"
    assert_same(out, whole)


def test_the_slurm_script_is_requeued_until_the_shot_is_done(whole, tmp_path):
    out = tmp_path / "out"
    job = Slurm(FARM / "slurm.sbatch", tmp_path)
    events = [("notice", FIRST + 6), ("node failure", FIRST + 16), ("preemption", FIRST + 20)]
    assert job.run(out, [*ARGUMENTS, "--checkpoint-every", "5f"], events) == 0
    assert job.starts == [0, "node failure", "preemption", 0]
    assert [attempt.get("end") for attempt in attempts(out)] == ["signal USR1", None, "signal TERM", "done"]
    assert {attempt["threads"] for attempt in attempts(out)} == {2}, "SLURM_CPUS_PER_TASK is not heard"
    assert_same(out, whole)
    # The log was continued, and progress goes on at its true value.
    log = job.log.read_text()
    before, after = log.split("stopped (signal USR1)")
    assert f"frame {FIRST + 6}/{LAST}" in before and f"frame {LAST}/{LAST}" in after
    assert tractor_percents(after.splitlines())[0] >= tractor_percents(before.splitlines())[-1] > 0


def test_a_cancelled_slurm_job_writes_a_checkpoint_and_is_not_requeued(tmp_path):
    out = tmp_path / "out"
    job = Slurm(FARM / "slurm.sbatch", tmp_path)
    assert job.run(out, ARGUMENTS, [("cancel", FIRST + 6)]) == 75
    assert attempts(out)[-1]["end"] == "signal TERM" and list((out / "checkpoints").glob("*.h5"))


def test_the_ssh_script_goes_to_the_next_machine_and_ends_when_it_is_told(whole, tmp_path, monkeypatch):
    # A stand-in for ssh: a machine that does not answer, one whose run is killed, and one that works.
    (tmp_path / "bin").mkdir()
    ssh, hosts = tmp_path / "bin" / "ssh", tmp_path / "hosts.txt"
    ssh.write_text(f"""#!/bin/bash
echo "${{@: -2:1}}" >> {hosts}
case ${{@: -2:1}} in
down) exit 255 ;;
failing)
    setsid bash -c "${{@: -1}}" &
    until grep -q '"last_complete_frame": *10' {tmp_path}/first/manifest.json; do sleep 0.01; done 2>/dev/null
    kill -s KILL -- -$!
    exit 137
    ;;
esac
exec bash -c "${{@: -1}}"
""")
    ssh.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}/bin:{os.environ['PATH']}")

    def start(names, out, resolution):
        command = ["bash", str(FARM / "ssh.sh"), names, str(out), *ARGUMENTS[:-1], f"resolution={resolution}"]
        return subprocess.Popen(command, cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True)

    first, second = tmp_path / "first", tmp_path / "second"
    assert start("down failing working", first, RESOLUTION).wait(PATIENCE) == 0
    assert [attempt.get("end") for attempt in attempts(first)] == [None, "done"]
    assert_same(first, whole)
    # An error that no machine can mend is passed on at once.
    assert start("working down", second, "none").wait(PATIENCE) == 78
    assert hosts.read_text().split() == ["down", "failing", "working", "working"]
    # The script stops the run through its folder, and ends with it.
    script = start("working", second, SLOW)
    wait_for_frame(second, FIRST, script)
    script.send_signal(signal.SIGTERM)
    assert script.wait(PATIENCE) == 75
    assert attempts(second)[-1]["end"] == "control/stop"


def test_status_of_many_runs_is_a_line_of_json_each(tmp_path):
    small(tmp_path)
    small(tmp_path / "other", "--max-wall", "0.001s")
    shown = drapery("status", tmp_path / "out", tmp_path / "other" / "out", tmp_path / "none", "--json")
    assert shown.returncode == 66 and "none" in shown.stderr
    done, stopped, missing = map(json.loads, shown.stdout.splitlines())
    assert (done["folder"], done["state"], done["end"], done["attempts"]) == (str(tmp_path / "out"), "done", "done", 1)
    assert (stopped["state"], stopped["end"], stopped["eta"], stopped["process"]) == ("stopped", "max-wall", None, None)
    assert (missing["state"], missing["folder"]) == ("unreadable", str(tmp_path / "none")) and missing["error"]
    assert done["host"] == os.uname().nodename and done["seconds"] > 0


# What schedulers look for in a line. Tractor's default filter uses `re.match`.
TRACTOR = [r"TR_PROGRESS\s+(\d+)", r"ALF_PROGRESS\s+(\d+)", r"(\d+)% done", r"R90000\s+(\d+)",
           r"Frame \d+ \((\d+) of \d+\)"]
TRACTOR_EXIT = r"(?:TR|ALF)_EXIT_STATUS\s+(\d+)"
OPENJD = r"openjd_progress: (\d+(?:\.\d+)?)$"
OPENJD_OTHERS = r"openjd_(?:status|fail|env|unset_env|redacted_env|session_runtime_loglevel)"
DEADLINE = r".*Progress: (\d+)%.*"
HOUDINI_ADAPTOR = r".*ALF_PROGRESS ([0-9]+)%.*"
# Deadline Cloud's strict mode fails a task that prints the first; OpenCue's log viewer paints the second red.
FATAL = r"(?i)error: |\[error\]"
RED = r"(?i)error|aborted|fatal|failed|killed"


def percents(lines, *patterns):
    return [float(found[1]) for line in lines for pattern in patterns if (found := re.match(pattern, line))]


def tractor_percents(lines):
    return percents(lines, *TRACTOR)


@pytest.mark.parametrize("mode, patterns", [
    ("tr", TRACTOR),
    ("alf", TRACTOR),
    ("alf", [HOUDINI_ADAPTOR]),
    ("alf", [r"(?i)alf_progress.*?(\d+)%"]),
    ("openjd", [OPENJD]),
    ("deadline", [DEADLINE]),
])
def test_schedulers_find_the_progress_and_nothing_else(mode, patterns, tmp_path):
    done = drapery("run", SCENE, "--frames", "1001-1012", "--set", "resolution=15", "--out", tmp_path,
                   "--progress", mode)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    found = percents(lines, *patterns)
    assert len(found) == 13 and found == sorted(found), found
    # 100 comes once, when everything is on the disk: two digits are all that some read.
    assert found[-1] == 100 and found[-2] <= 99 and percents(lines[-1:], *patterns) == [100]
    for pattern in (TRACTOR_EXIT, OPENJD_OTHERS, FATAL, RED):
        assert not [line for line in lines + done.stderr.splitlines() if re.search(pattern, line)]


@pytest.mark.parametrize("mode", ["auto", "json", "none"])
def test_other_modes_print_nothing_that_schedulers_take_for_progress(mode, tmp_path):
    done = drapery("run", SCENE, "--frames", "1001-1004", "--set", "resolution=10", "--out", tmp_path,
                   "--progress", mode)
    lines = done.stdout.splitlines()
    assert not percents(lines, *TRACTOR, TRACTOR_EXIT, OPENJD, DEADLINE, HOUDINI_ADAPTOR)
    assert (mode == "none") == (not lines)
    if mode == "json":
        records = [json.loads(line) for line in lines]
        assert records[-1] == {"record": "end", "exit_code": 0}
        assert [record["frame"] for record in records[:-1]] == [1001, 1002, 1003, 1004]


def test_a_fatal_message_has_the_word_that_strict_farms_look_for(tmp_path):
    failed = drapery("run", tmp_path / "none.toml")
    assert re.search(FATAL, failed.stderr) and failed.stdout == ""


def small(tmp_path, *arguments, **options):
    return drapery("run", SCENE, "--frames", "1001-1003", "--set", "resolution=10", "--out", tmp_path / "out",
                   *arguments, **options).returncode


def test_exit_codes_are_those_of_the_page(tmp_path):
    scene = SCENE.read_text()
    bad = tmp_path / "bad.toml"

    def run_scene_text(text):
        bad.write_text(text)
        return drapery("run", bad, "--frames", "1001-1002", "--out", tmp_path / "bad").returncode

    mesh = scene.replace('panel = { resolution = "$resolution", side = 1.0, aspect = 1.0, center = [0, 1.5, 0] }',
                         'rest = "sheet.obj"').replace('corners = ["i0j0", "inj0"]', "vertices = [0]")
    mesh = mesh.replace("[gravity]", '[units]\nlength = "m"\nup = "Y"\n[gravity]', 1)
    assert mesh.count("sheet.obj") == 1 and "$resolution" not in mesh
    assert drapery("run", SCENE, "--frames", "nonsense").returncode == 2
    assert small(tmp_path) == 0
    assert small(tmp_path) == 0  # all frames are there
    assert small(tmp_path, "--set", "resolution=11") == 73
    assert small(tmp_path, "--resume", "never") == 73
    assert small(tmp_path, "--resume", "1002") == 2
    assert small(tmp_path, "--overwrite", "--max-wall", "0.001s") == 75
    assert small(tmp_path, "--overwrite", "--max-wall", "0.001s", "--resumable-exit-code", "99") == 99
    assert run_scene_text(mesh) == 66
    (tmp_path / "sheet.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n")
    assert run_scene_text(mesh) == 65
    assert run_scene_text(scene.replace("material", "materal")) == 78
    assert drapery("status", tmp_path / "nothing").returncode == 66


def test_a_full_disk_is_exit_code_74_and_the_run_goes_on_when_there_is_room(tmp_path):
    def no_more_than(length):
        def limit():
            # A write beyond the limit is then an error, as on a full disk, and not the end of the process.
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (length, length))
        return limit

    def run(out, **options):
        settings = ["--set", "resolution=30", "--set", 'output.format=["abc"]']
        return drapery("run", SCENE, "--frames", "1001-1020", *settings, "--checkpoint-every", "4f", "--out", out,
                       **options)

    out = tmp_path / "out"
    assert run(out, preexec_fn=no_more_than(300_000), restore_signals=False).returncode == 74
    assert json.loads((out / "manifest.json").read_text())["state"] == "failed"
    assert "File too large" in drapery("status", out).stdout
    assert run(out).returncode == 0
    assert attempts(out)[-1]["first_frame"] > FIRST, "no checkpoint was left"
    assert run(tmp_path / "whole").returncode == 0
    assert (out / "sheet.abc").read_bytes() == (tmp_path / "whole" / "sheet.abc").read_bytes()


def test_differences_are_exit_code_1(tmp_path):
    for resolution in (10, 11):
        drapery("run", SCENE, "--frames", "1001-1002", "--set", f"resolution={resolution}",
                "--out", tmp_path / str(resolution))
    assert drapery("diff", tmp_path / "10", tmp_path / "10").returncode == 0
    assert drapery("diff", tmp_path / "10", tmp_path / "11").returncode == 1


def test_the_page_has_every_exit_code_that_the_help_has():
    printed = re.findall(r"^ {1,3}(\d+)  ", drapery("--help").stdout.split("Exit codes:")[1], re.MULTILINE)
    page = (ROOT / "docs" / "guide" / "farm.md").read_text()
    assert len(printed) > 10 and printed == re.findall(r"^\| \*{0,2}(\d+)\*{0,2} \|", page, re.MULTILINE)


def test_every_option_that_page_and_examples_name_exists():
    known = {option for command in ("run", "status", "stop", "diff", "report")
             for option in re.findall(r"--[a-z-]+", drapery(command, "--help").stdout)}
    page = (ROOT / "docs" / "guide" / "farm.md").read_text()
    named = {(file.name, option) for file in FARM.rglob("*.*") if file.is_file()
             for line in file.read_text().splitlines() if not line.startswith("#")
             for option in re.findall(r"--[a-z][a-z-]+", line)}
    named |= {("farm.md", option) for option in re.findall(r"`(--[a-z][a-z-]+)", page)}
    foreign = {"--signal", "--requeue", "--open-mode", "--job-name", "--mca", "--mpi", "--kill-on-bad-exit", "--cpus-per-task", "--parsable",
               "--dependency", "--kill-on-invalid-dep", "--ntasks", "--partition", "--max-worker-count", "--max-retries-per-task"}
    assert len(named) > 20
    assert not {(file, option) for file, option in named if option not in known | foreign}
