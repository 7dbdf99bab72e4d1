"""Runs on many processes: the bytes of one, whatever number of ranks works on them, and an orderly end for all of them.

The program has to be built with MPI (`cargo build --release -p drapery --features mpi`). `DRAPERY_MPI` names it, if it is
another one than `DRAPERY`.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from farm import BAD_INPUT, DONE, DRAPERY, IO, MISSING_INPUT, PATIENCE, STOPPED, Shot
from judges import ROOT, SHARED
from test_mpi import AS_ROOT, MORE_THAN_CORES, await_end

PROGRAM = os.environ.get("DRAPERY_MPI", DRAPERY)
ENVIRONMENT = {**os.environ, **AS_ROOT, **MORE_THAN_CORES, "OMPI_MCA_mpi_yield_when_idle": "1", "RUST_BACKTRACE": "0"}

# Exit codes beside those in `farm`.
USAGE, SCENE = 2, 78

SAMPLES = ROOT / "sample_assets" / "scenes"

# Short runs of coarse cloth, most of them of several logical parts: what else would there be to share?
CASES = {
    "twister": (SAMPLES / "twister.toml", "0-3", {"resolution": 40}),
    "spinning_ball": (SAMPLES / "spinning_ball.toml", "0-3", {"resolution": 72}),
    "leaves": (SAMPLES / "leaves.toml", "0-3", {"rows": 2}),
    "dressed_woman": (ROOT / "tests" / "scenes" / "dressed_woman.toml", "0-1", {}),
}


def is_built_with_mpi():
    """A process that seems to be one of two says which of them it knows."""
    alone = os.environ | {"OMPI_COMM_WORLD_SIZE": "2", "OMPI_COMM_WORLD_RANK": "0"} | AS_ROOT
    done = subprocess.run([PROGRAM, "run", "none.toml"], env=alone, capture_output=True, text=True, timeout=PATIENCE)
    return "built without MPI" not in done.stderr


pytestmark = [
    pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun"),
    pytest.mark.skipif(not os.path.isfile(PROGRAM) or not is_built_with_mpi(), reason="drapery was built without MPI"),
]


class Ranks:
    """A shot as `mpirun` runs it."""

    def __init__(self, shot, ranks):
        self.shot, self.ranks = shot, ranks

    def command(self, out, *options, before=(), **how):
        line = [*before, PROGRAM, *self.shot.command(out, *options, threads=1, **how)[1:]]
        return line if self.ranks == 1 else ["mpirun", "-n", str(self.ranks), *line]

    def run(self, out, *options, code=DONE, **how):
        command = self.command(out, *options, **how)
        done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL,
                              timeout=PATIENCE)
        said = done.stdout + done.stderr
        assert done.returncode == code, f"exit code {done.returncode} of {' '.join(command)}\n{said[-4000:]}"
        return said

    def start(self, out, *options, **how):
        log = Path(f"{out}.words").open("a")
        command = self.command(out, *options, **how)
        return subprocess.Popen(command, env=ENVIRONMENT, text=True, stdin=subprocess.DEVNULL, stdout=log, stderr=log)


def results(out):
    """Caches and checkpoints."""
    found = {}
    for folder in (out, out / "checkpoints"):
        for path in sorted(folder.iterdir()):
            if path.suffix in (".abc", ".h5"):
                found[str(path.relative_to(out))] = path.read_bytes()
    assert any(name.endswith(".abc") for name in found), f"no caches in {out}"
    return found


def assert_same(expected, found, what):
    assert expected.keys() <= found.keys(), what
    for name, content in expected.items():
        assert found[name] == content, f"{name} is another with {what}"


@pytest.mark.parametrize("case", CASES)
def test_any_number_of_ranks_writes_the_same_bytes(case, tmp_path, report_figure):
    scene, frames, parameters = CASES[case]
    if case == "dressed_woman" and not SHARED.is_dir():
        pytest.skip("no shared data")
    shot, expected, seconds = Shot(scene, frames, **parameters), None, []
    for ranks in (1, 2, 3, 7):
        out = tmp_path / str(ranks)
        began = time.monotonic()
        Ranks(shot, ranks).run(out)
        seconds.append(f"{ranks}: {time.monotonic() - began:.1f} s")
        expected = expected or results(out)
        assert_same(expected, results(out), f"{ranks} ranks")
    report_figure(", ".join(seconds))


# A strip that has work for several ranks, and takes some seconds.
LONG = Shot(SAMPLES / "twister.toml", "0-14", resolution=40)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of a run that nobody disturbs."""
    out = tmp_path_factory.mktemp("whole") / "out"
    Ranks(LONG, 1).run(out)
    return results(out)


def last_frame(out):
    """Last complete frame, or -1."""
    try:
        frame = json.loads((out / "manifest.json").read_text())["last_complete_frame"]
    except (FileNotFoundError, json.JSONDecodeError):
        return -1
    return -1 if frame is None else frame


def wait_while_running(job, out, holds, what):
    """Waits until something holds in a run, which may not end before."""
    deadline = time.monotonic() + PATIENCE
    while not holds():
        assert job.poll() is None, f"ended with {job.returncode}:\n{Path(f'{out}.words').read_text()[-4000:]}"
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


def await_frame(job, out, frame):
    wait_while_running(job, out, lambda: last_frame(out) >= frame, f"frame {frame} does not come")


def processes(out):
    """Process of each rank that writes into a folder."""
    found = {}
    for folder in Path("/proc").iterdir():
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            about = (folder / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        rank = [word for word in about if word.startswith(b"OMPI_COMM_WORLD_RANK=")]
        if str(out).encode() in words and words[0] == str(PROGRAM).encode() and rank:
            found[int(rank[0].split(b"=")[1])] = int(folder.name)
    return found


def wait(job, out, code):
    job.wait(timeout=PATIENCE)
    assert job.returncode == code, f"exit code {job.returncode}\n{Path(f'{out}.words').read_text()[-4000:]}"


# Number of ranks, who gets the signal, which, and how the manifest calls the end. Each attempt goes on where the one before
# has stopped, with another number of ranks.
STOPS = [
    (4, [2], signal.SIGUSR1, "signal USR1"),
    (3, [0], signal.SIGTERM, "signal TERM"),
    (5, [4], signal.SIGINT, "signal INT"),
    (2, [0, 1], signal.SIGTERM, "signal TERM"),
    (3, "mpirun", signal.SIGUSR1, "signal USR1"),
]


def test_a_signal_to_any_rank_stops_all_and_other_ranks_go_on_to_the_same_bytes(whole, tmp_path):
    out = tmp_path / "out"
    for ranks, targets, number, reason in STOPS:
        frame = last_frame(out) + 2
        job = Ranks(LONG, ranks).start(out)
        await_frame(job, out, frame)
        found = processes(out)
        assert sorted(found) == list(range(ranks))
        for process in [job.pid] if targets == "mpirun" else [found[rank] for rank in targets]:
            os.kill(process, number)
        wait(job, out, STOPPED)
        manifest = json.loads((out / "manifest.json").read_text())
        assert (manifest["state"], manifest["attempts"][-1]["end"]) == ("stopped", reason)
        assert manifest["attempts"][-1]["ranks"] == ranks
    Ranks(LONG, 3).run(out)
    assert_same(whole, results(out), "stops and other ranks")


def test_a_second_signal_stops_all_at_once(tmp_path):
    out = tmp_path / "out"
    job = Ranks(LONG, 3).start(out)
    await_frame(job, out, 1)
    rank = processes(out)[1]
    os.kill(rank, signal.SIGTERM)
    os.kill(rank, signal.SIGINT)
    wait(job, out, STOPPED)


def test_a_launcher_that_is_terminated_leaves_a_run_that_goes_on(whole, tmp_path):
    """Open MPI's mpirun sends SIGTERM to the ranks after a second, and SIGKILL after another: some stop in order."""
    out = tmp_path / "out"
    job = Ranks(LONG, 3).start(out)
    await_frame(job, out, 2)
    found = processes(out)
    began = time.monotonic()
    job.send_signal(signal.SIGTERM)
    job.wait(timeout=PATIENCE)
    assert job.returncode != DONE
    # Where the machine is busy, a rank that was killed outlives its launcher for a moment.
    await_end(found, began)
    assert last_frame(out) < LONG.last
    Ranks(LONG, 2).run(out)
    assert_same(whole, results(out), "a launcher that was terminated")


@pytest.mark.parametrize("lost", [0, 2])
def test_a_killed_rank_ends_the_job_and_it_goes_on(whole, tmp_path, report_figure, lost):
    out = tmp_path / "out"
    job = Ranks(LONG, 3).start(out, "--checkpoint-every", "2f")
    await_frame(job, out, 4)
    found = processes(out)
    began = time.monotonic()
    os.kill(found[lost], signal.SIGKILL)
    job.wait(timeout=PATIENCE)
    assert job.returncode != 0
    await_end(found, began)
    report_figure(f"without rank {lost} the others ended after {time.monotonic() - began:.1f} s")
    Ranks(LONG, 2).run(out, "--checkpoint-every", "2f")
    found = results(out)
    assert_same({name: whole[name] for name in whole if name in found}, found, "a killed rank")
    assert any(name.endswith(".abc") for name in found)


def errors(said):
    return re.findall(r"^Error: .*", said, re.MULTILINE)


def test_what_is_wrong_on_rank_0_is_said_once_and_all_end_with_its_exit_code(tmp_path):
    scene = (SAMPLES / "twister.toml").read_text()
    (tmp_path / "typo.toml").write_text(scene.replace("friction", "frction"))
    (tmp_path / "thin.toml").write_text(scene.replace("total_mass = 0.36", "total_mass = -1"))
    coat = "[units]\nlength = 'm'\nup = 'Y'\n\n[[garment]]\nname = 'coat'\nrest = 'coat.obj'\ndensity = 0.1\n"
    (tmp_path / "missing.toml").write_text(scene + coat)
    (tmp_path / "broken.toml").write_text(scene + coat.replace("coat.obj", "broken.obj"))
    (tmp_path / "broken.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    for name, code in [("typo", SCENE), ("thin", SCENE), ("missing", MISSING_INPUT), ("broken", BAD_INPUT)]:
        said = Ranks(Shot(tmp_path / f"{name}.toml", "0-2", resolution=10), 3).run(tmp_path / "out", code=code)
        assert len(errors(said)) == 1, said
    (tmp_path / "file").write_text("")
    occupied = Ranks(Shot(SAMPLES / "twister.toml", "0-2", resolution=10), 3)
    command = occupied.command(tmp_path / "file" / "out")
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode in (73, 74) and len(errors(done.stderr)) == 1, done.stderr
    done = subprocess.run(["mpirun", "-n", "3", PROGRAM, "run", "--nonsense"], env=ENVIRONMENT, capture_output=True,
                          text=True, timeout=PATIENCE)
    assert done.returncode == USAGE and done.stderr.count("unexpected argument") == 1, done.stderr


def test_a_disk_that_refuses_ends_all_ranks(tmp_path):
    shot = Ranks(Shot(SAMPLES / "twister.toml", "0-900", resolution=40), 3)
    # Files may have 8 MiB: the memory that ranks share fits into that, the cache of all frames does not.
    small = ["bash", "-c", "trap '' XFSZ; ulimit -f 8192; exec \"$@\"", "bash"]
    said = shot.run(tmp_path / "out", code=IO, before=small)
    assert len(errors(said)) == 1, said


def test_other_commands_are_done_once(tmp_path):
    command = ["mpirun", "-n", "3", PROGRAM, "check", str(SAMPLES / "twister.toml")]
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == DONE and done.stdout.count("can be simulated") == 1, done.stdout + done.stderr
