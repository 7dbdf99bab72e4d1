"""Ranks on two machines with a slow cable between them: the bytes of one rank, for both integrators, also after a stop and with another
number of ranks.

The two machines are those of `machines.py`; where the system lets nobody make these, all of it is skipped.
"""

import json
import os
import shutil
import signal
import subprocess

import pytest

from farm import DONE, PATIENCE, STOPPED, Shot
from judges import ROOT
from test_mpi_runs import ENVIRONMENT, PROGRAM, Ranks, assert_same, await_frame, is_built_with_mpi, processes, results, wait

pytestmark = [
    pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun"),
    pytest.mark.skipif(not os.path.isfile(PROGRAM) or not is_built_with_mpi(), reason="drapery was built without MPI"),
]

INTEGRATORS = "semi_implicit", "tr_bdf2"

# Rate of the cable each way [bit/s].
RATE = 1e9


def shot(integrator, frames, **parameters):
    """A sheet of 3,277 vertices whose four layers touch each other and a ball."""
    scene = ROOT / "tests" / "scenes" / "folded_on_a_ball.toml"
    return Shot(scene, frames, **{"solver.integrator": integrator}, **parameters)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Results of runs on one rank, each made once."""
    made = {}

    def run(which):
        key = " ".join(which.command("out"))
        if key not in made:
            out = tmp_path_factory.mktemp("alone") / "out"
            Ranks(which, 1).run(out)
            made[key] = results(out)
        return made[key]

    return run


def over(machines, which, ranks, out, *options):
    """The command of a shot on two machines."""
    return machines.mpirun(ranks, PROGRAM, *which.command(out, *options, threads=1)[1:])


def run(*what):
    command = over(*what)
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PATIENCE)
    assert done.returncode == DONE, (done.stdout + done.stderr)[-4000:]


def counts(out):
    return json.loads((out / "run.jsonl").read_text().splitlines()[-1])["counts"]


def assert_run_is_that_of_one_rank(machines, which, ranks, out, alone):
    """Runs it, and compares. Bytes that two ranks send each other are bytes that went through the cable."""
    before = machines.passed()
    run(machines, which, ranks, out)
    found, passed = counts(out), machines.passed() - before
    assert found["repulsions"] > 1000 and found["body_contacts"] > 10, f"nothing touches: {found}"
    assert ranks > 2 or passed > found["bytes_sent"] > 1e6, f"{passed} bytes went through the cable: {found}"
    assert_same(alone(which), results(out), f"{ranks} ranks on two machines")
    return passed


@pytest.mark.parametrize("delay, ranks", [pytest.param(0.0, 3, marks=pytest.mark.full), (50e-6, 2), pytest.param(500e-6, 2, marks=pytest.mark.full)])
def test_two_machines_write_the_bytes_of_one_rank(make_machines, alone, tmp_path, report_figure, delay, ranks):
    machines = make_machines(delay=delay, rate=RATE)
    shortest = machines.round_trips(20)[0]
    assert shortest >= 2.0 * delay
    for integrator in INTEGRATORS:
        passed = assert_run_is_that_of_one_rank(machines, shot(integrator, "0-2"), ranks, tmp_path / integrator, alone)
        report_figure(f"{integrator}, {ranks} ranks: {passed / 1e6:.0f} MB, {shortest * 0.5e6:.0f} µs one way at the least")


@pytest.mark.parametrize("integrator", [pytest.param(INTEGRATORS[0], marks=pytest.mark.full), INTEGRATORS[1]])
def test_a_run_on_two_machines_that_stops_goes_on_with_other_ranks_to_the_same_bytes(make_machines, alone, tmp_path, integrator):
    machines, out, which = make_machines(delay=50e-6, rate=RATE), tmp_path / "out", shot(integrator, "0-2")
    with open(f"{out}.words", "w") as words:
        job = subprocess.Popen(over(machines, which, 2, out), env=ENVIRONMENT, stdin=subprocess.DEVNULL, stdout=words, stderr=words)
    await_frame(job, out, 0)
    os.kill(processes(out)[1], signal.SIGTERM)
    wait(job, out, STOPPED)
    run(machines, which, 3, out)
    attempts = json.loads((out / "manifest.json").read_text())["attempts"]
    assert [attempt["ranks"] for attempt in attempts] == [2, 3] and attempts[1]["first_frame"] > 0
    assert_same(alone(which), results(out), "a stop, and another number of ranks")


@pytest.mark.full
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("ranks", [2, 4])
def test_a_larger_sheet_on_two_machines_has_the_bytes_of_one_rank(make_machines, alone, tmp_path, integrator, ranks):
    """14,701 vertices, of which the layers touch all over."""
    machines = make_machines(delay=500e-6, rate=RATE)
    assert_run_is_that_of_one_rank(machines, shot(integrator, "0-8", resolution=60), ranks, tmp_path / "out", alone)
