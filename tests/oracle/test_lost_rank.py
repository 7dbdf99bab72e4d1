"""A rank that is lost: a link that is cut, a process that stands still. All ranks end within seconds, say which rank is gone, and the
run continues from its last checkpoint to the same bytes.

The two machines are those of `machines.py`; where the system lets nobody make these, that test is skipped.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import time

import pytest

from farm import DONE, PATIENCE, Shot
from test_mpi import running
from test_mpi_runs import (ENVIRONMENT, PROGRAM, SAMPLES, Ranks, assert_same, await_frame, is_built_with_mpi, last_frame,
                           processes, results, wait_while_running)

pytestmark = [
    pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun"),
    pytest.mark.skipif(not os.path.isfile(PROGRAM) or not is_built_with_mpi(), reason="drapery was built without MPI"),
]

# Lasts until it is disturbed in its second frame, and not much longer.
LONG = Shot(SAMPLES / "twister.toml", "0-14", resolution=32)

# Exit code of a rank that has lost another one.
RANK_LOST = 69

# Silence after which a rank is lost [s]: short, to keep the tests so.
TIMEOUT = 3
QUICK = {"DRAPERY_RANK_TIMEOUT": f"{TIMEOUT}s"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of a run that nobody disturbs."""
    out = tmp_path_factory.mktemp("whole") / "out"
    Ranks(LONG, 1).run(out)
    return results(out)


def status(out):
    done = subprocess.run([PROGRAM, "status", str(out), "--json"], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def wait_until(holds, what):
    began = time.monotonic()
    while not holds():
        assert time.monotonic() - began < PATIENCE, what
        time.sleep(0.1)
    return time.monotonic() - began


def await_heartbeats(job, out, frame):
    """Waits for a frame, and for the connections of the heartbeats: only after them is a lost rank noticed."""
    await_frame(job, out, frame)

    def are_connected():
        return any("heartbeats with all ranks" in log.read_text() for log in (out / "logs").glob("*.log"))

    wait_while_running(job, out, are_connected, "no heartbeats")


def test_a_cut_link_ends_both_sides_within_seconds_and_one_machine_goes_on(whole, make_machines, tmp_path, report_figure):
    machines = make_machines()
    out, folder = tmp_path / "out", machines.folder
    run = LONG.command(out, "--checkpoint-every", "1f", threads=1)
    launch = machines.mpirun(2, folder / "rank", folder, PROGRAM, *run[1:])
    with open(f"{out}.words", "w") as words:
        job = subprocess.Popen(launch, env=ENVIRONMENT | QUICK, stdin=subprocess.DEVNULL, stdout=words, stderr=words)
    await_heartbeats(job, out, 2)
    assert sorted(processes(out)) == [0, 1]
    began = time.monotonic()
    machines.cut()
    wait_until(lambda: not any(running(process) for process in processes(out).values()), "ranks are still there")
    ranks = time.monotonic() - began
    # Who is gone is said on both sides, with the exit code for it.
    for rank, other in ((0, 1), (1, 0)):
        wait_until((folder / f"code.{rank}").exists, "a rank's shell is still there")
        said = (folder / f"words.{rank}").read_text()
        assert re.search(rf"^Error: rank {other} of 2 \(\S+:\d+\) sent no heartbeat for {TIMEOUT} s", said, re.MULTILINE), said
        assert int((folder / f"code.{rank}").read_text()) == RANK_LOST
    job.wait(timeout=PATIENCE)
    launcher = time.monotonic() - began
    assert job.returncode != DONE
    wait_until(lambda: not machines.left(), f"left behind: {machines.left()}")
    report_figure(f"after the cut ranks ended in {ranks:.1f} s, mpirun in {launcher:.1f} s, all else in "
                  f"{time.monotonic() - began:.1f} s")
    # Left to themselves, ranks wait for ever and mpirun for a quarter of an hour.
    assert ranks < 60 and launcher < 120
    # The folder says why, has a checkpoint, and is free.
    found = status(out)
    assert found["state"] == "failed" and re.match(r"rank 1 of 2 \(\S+:\d+\) sent no heartbeat", found["error"]), found
    assert found["checkpoint"]["frame"] >= 1 and not (out / "lock.json").exists()
    before = last_frame(out)
    assert before < LONG.last
    # The machine that is left continues, on another number of ranks.
    command = machines.command("near", "mpirun", "-n", 3, PROGRAM, *LONG.command(out, "--checkpoint-every", "1f", threads=1)[1:])
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PATIENCE)
    assert done.returncode == DONE, done.stdout + done.stderr
    attempts = json.loads((out / "manifest.json").read_text())["attempts"]
    assert [attempt["ranks"] for attempt in attempts] == [2, 3] and attempts[1]["first_frame"] > 1
    found = results(out)
    assert_same({name: whole[name] for name in whole if name in found}, found, "a cut link")
    assert any(name.endswith(".abc") for name in found)


def start(out, timeout):
    with open(f"{out}.words", "a") as words:
        return subprocess.Popen(Ranks(LONG, 3).command(out, "--checkpoint-every", "2f"), stdin=subprocess.DEVNULL, stdout=words,
                                stderr=words, env=ENVIRONMENT | {"DRAPERY_RANK_TIMEOUT": timeout})


@pytest.mark.parametrize("lost", [0, 2])
def test_a_rank_that_stands_still_is_lost_and_the_others_end(whole, tmp_path, report_figure, lost):
    out = tmp_path / "out"
    job = start(out, f"{TIMEOUT}s")
    await_heartbeats(job, out, 4)
    found = processes(out)
    began = time.monotonic()
    os.kill(found[lost], signal.SIGSTOP)
    job.wait(timeout=PATIENCE)
    report_figure(f"mpirun ended {time.monotonic() - began:.1f} s after rank {lost} stood still")
    said = (tmp_path / "out.words").read_text()
    assert re.search(rf"^Error: rank {lost} of 3 \(\S+:{found[lost]}\) sent no heartbeat for {TIMEOUT} s", said, re.MULTILINE), said
    assert job.returncode == RANK_LOST, said
    wait_until(lambda: not any(map(running, found.values())), "a rank is still there")
    # Rank 0 writes why; where it is the one that is lost, nobody else does, and the process is seen to be gone.
    if lost == 0:
        assert status(out)["state"] == "killed" and status(out)["process"]["presence"] == "gone"
    else:
        assert status(out)["state"] == "failed" and f"rank {lost} of 3" in status(out)["error"]
    Ranks(LONG, 2).run(out, "--checkpoint-every", "2f")
    found = results(out)
    assert_same({name: whole[name] for name in whole if name in found}, found, "a rank that stood still")


def test_a_rank_that_is_stopped_for_a_while_is_not_lost(whole, tmp_path):
    out = tmp_path / "out"
    job = start(out, "20s")
    await_heartbeats(job, out, 2)
    found = processes(out)
    # Longer than several heartbeats.
    for rank in (0, 1):
        os.kill(found[rank], signal.SIGSTOP)
        time.sleep(5)
        os.kill(found[rank], signal.SIGCONT)
    job.wait(timeout=PATIENCE)
    assert job.returncode == DONE, (tmp_path / "out.words").read_text()
    found = results(out)
    assert_same({name: whole[name] for name in whole if name in found}, found, "ranks that were stopped for a while")


@pytest.mark.parametrize("timeout, code", [("0", DONE), ("soon", 2), ("0.1s", 2)])
def test_the_time_is_a_setting_and_what_is_none_is_said_once(tmp_path, timeout, code):
    environment = ENVIRONMENT | {"DRAPERY_RANK_TIMEOUT": timeout}
    command = ["mpirun", "-n", "2", PROGRAM, "check", str(LONG.scene)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == code, done.stderr
    assert done.stderr.count("Error: DRAPERY_RANK_TIMEOUT=") == (code == 2)
