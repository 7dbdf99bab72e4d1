"""Ranks as MPI processes keep the promises of a communicator, and none is left waiting for one that is lost.

`DRAPERY_CONFORMANCE` names the program that `core/mpi/examples/conformance.rs` describes; `make test` sets it. Without
it the one in `target/release/examples/` is taken.
"""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest

from farm import PATIENCE
from judges import ROOT

pytestmark = pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun")

# Open MPI asks before it starts as root, as in a container; tests start more ranks than there are cores.
AS_ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
MORE_THAN_CORES = {"OMPI_MCA_rmaps_base_oversubscribe": "1", "OMPI_MCA_hwloc_base_binding_policy": "none"}


@pytest.fixture
def conformance():
    """Starts the program on a number of ranks."""
    path = os.environ.get("DRAPERY_CONFORMANCE", str(ROOT / "target/release/examples/conformance"))
    assert os.path.isfile(path), f"{path} does not exist; build it: cargo build --release -p drapery-mpi --examples"
    started = []

    def start(ranks, *arguments):
        environment = {**os.environ, **AS_ROOT, **MORE_THAN_CORES, "RUST_BACKTRACE": "0"}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        command = ["mpirun", "-n", str(ranks), path, *arguments]
        started.append(subprocess.Popen(command, env=environment, text=True, **pipes))
        return started[-1]

    yield start
    for job in started:
        if job.poll() is None:
            job.terminate()
            job.wait(timeout=PATIENCE)
        job.stdin.close()
        job.stdout.close()


@pytest.mark.parametrize("ranks", [1, 2, 3, 4, 7])
def test_mpi_ranks_keep_the_promises(conformance, ranks):
    job = conformance(ranks)
    said, _ = job.communicate(timeout=PATIENCE)
    assert job.returncode == 0, said
    assert f"{ranks} ranks keep the promises" in said


def test_a_rank_that_panics_ends_the_job_with_its_message(conformance):
    job = conformance(4, "panic")
    said, _ = job.communicate(timeout=PATIENCE)
    assert job.returncode == 70, said
    assert re.search(r"rank 2 of 4: panicked at .*\nthe cloth has come apart", said)
    assert said.count("panicked") == 1, said


def test_a_rank_can_end_the_others_with_an_exit_code(conformance):
    job = conformance(3, "abort")
    said, _ = job.communicate(timeout=PATIENCE)
    assert job.returncode == 3, said


def running(process):
    """Whether a process is there and not merely waiting to be forgotten."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def await_end(processes, began):
    """Waits until none of these ranks runs, for `PATIENCE` since `began`."""
    while any(map(running, processes.values())):
        assert time.monotonic() - began < PATIENCE, f"still there: {list(filter(running, processes.values()))}"
        time.sleep(0.1)


@pytest.mark.parametrize("lost", [0, 3])
def test_a_rank_killed_from_outside_ends_the_others(conformance, report_figure, lost):
    job = conformance(4, "wait")
    processes = {}
    while len(processes) < 4:
        line = job.stdout.readline()
        assert line, f"the ranks ended before they were told to: {job.wait()}"
        if found := re.match(r"rank (\d) is process (\d+)", line):
            processes[int(found[1])] = int(found[2])
    began = time.monotonic()
    os.kill(processes[lost], signal.SIGKILL)
    said, _ = job.communicate(timeout=PATIENCE)
    assert job.returncode != 0, said
    await_end(processes, began)
    report_figure(f"without rank {lost} the others ended after {time.monotonic() - began:.1f} s")


def test_a_launcher_of_another_mpi_is_noticed():
    """A process that is told of others and sees none would compute, and write, what they compute as well."""
    path = os.environ.get("DRAPERY_CONFORMANCE", str(ROOT / "target/release/examples/conformance"))
    environment = {**os.environ, **AS_ROOT, "OMPI_COMM_WORLD_SIZE": "3"}
    done = subprocess.run([path], env=environment, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode != 0
    assert "started as one of 3 processes, but the MPI library sees 1" in done.stderr, done.stderr
