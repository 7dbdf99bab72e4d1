"""A rank that is lost: a link that is cut, a process that stands still. All ranks end within seconds, say which rank is gone, and the
run continues from its last checkpoint to the same bytes.

The two machines are network namespaces with a cable between them; where the system lets nobody make these, that test is skipped.
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

from farm import DONE, PATIENCE, Shot
from test_mpi import running
from test_mpi_runs import (ENVIRONMENT, PROGRAM, SAMPLES, Ranks, assert_same, await_frame, is_built_with_mpi, last_frame,
                           processes, results)

pytestmark = [
    pytest.mark.skipif(not shutil.which("mpirun"), reason="no mpirun"),
    pytest.mark.skipif(not os.path.isfile(PROGRAM) or not is_built_with_mpi(), reason="drapery was built without MPI"),
]

# Lasts until it is disturbed in its second frame, and not much longer.
LONG = Shot(SAMPLES / "twister.toml", "0-14", resolution=16)

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


# Two machines, each a network of its own, and a cable between them. What is started inside ends with the shell.
MACHINES = r"""
set -e
mount -t tmpfs none /run
mkdir /run/netns
ip netns add near
ip netns add far
ip link add to_far type veth peer name to_near
ip link set to_far netns near
ip link set to_near netns far
ip -n near address add 10.9.0.1/24 dev to_far
ip -n far address add 10.9.0.2/24 dev to_near
for machine in near far; do ip -n $machine link set lo up; done
ip -n near link set to_far up
ip -n far link set to_near up
printf '127.0.0.1 localhost\n10.9.0.1 near\n10.9.0.2 far\n' > "$1/hosts"
mount --bind "$1/hosts" /etc/hosts
ip netns exec far true
echo ready $$
exec cat
"""

# How mpirun starts its part on the other machine, and what starts each rank: both sides' words and exit codes are kept.
AGENT = '#!/bin/sh\nmachine=$1; shift\nexec ip netns exec "$machine" sh -c "$*"\n'
RANK = '#!/bin/sh\nfolder=$1; shift\n"$@" 2> "$folder/words.$OMPI_COMM_WORLD_RANK"\ncode=$?\n' \
       'echo $code > "$folder/code.$OMPI_COMM_WORLD_RANK"\nexit $code\n'


class Machines:
    """Two machines that share a disk and are connected by a cable."""

    def __init__(self, folder):
        self.folder = folder
        for name, text in (("agent", AGENT), ("rank", RANK)):
            (folder / name).write_text(text)
            (folder / name).chmod(0o755)
        as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
        command = ["unshare", *as_root, "--mount", "--net", "--pid", "--fork", "--mount-proc", "--kill-child", "bash", "-c", MACHINES,
                   "bash", str(folder)]
        self.shell = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        if not self.shell.stdout.readline().startswith("ready"):
            said = self.shell.communicate(timeout=PATIENCE)[1]
            pytest.skip(f"no network namespaces can be made here: {said.strip()[-300:]}")
        inside = Path(f"/proc/{self.shell.pid}/task/{self.shell.pid}/children").read_text().split()[0]
        self.enter = ["nsenter", *([] if not as_root else ["--user", "--preserve-credentials"]), "--mount", "--net", "--pid",
                      "--target", inside]

    def command(self, machine, *words):
        return [*self.enter, "ip", "netns", "exec", machine, *map(str, words)]

    def ask(self, *words):
        return subprocess.run([*self.enter, *words], capture_output=True, text=True, check=True, timeout=PATIENCE).stdout

    def cut(self):
        self.ask("ip", "-n", "near", "link", "set", "to_far", "down")

    def left(self):
        """Processes on both machines."""
        return [(machine, int(pid)) for machine in ("near", "far") for pid in self.ask("ip", "netns", "pids", machine).split()]

    def close(self):
        self.shell.kill()
        self.shell.communicate(timeout=PATIENCE)


@pytest.fixture
def machines(tmp_path):
    folder = tmp_path / "machines"
    folder.mkdir()
    if not shutil.which("ip") or not shutil.which("unshare"):
        pytest.skip("no ip or unshare: no network namespaces can be made")
    two = Machines(folder)
    yield two
    two.close()


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


def test_a_cut_link_ends_both_sides_within_seconds_and_one_machine_goes_on(whole, machines, tmp_path, report_figure):
    out, folder = tmp_path / "out", machines.folder
    run = LONG.command(out, "--checkpoint-every", "1f", threads=1)
    launch = ["mpirun", "-n", 2, "--host", "near:1,far:1", "--map-by", "node", "--mca", "btl", "tcp,self", "--mca", "plm_rsh_agent",
              folder / "agent", folder / "rank", folder, PROGRAM, *run[1:]]
    with open(f"{out}.words", "w") as words:
        job = subprocess.Popen(machines.command("near", *launch), env=ENVIRONMENT | QUICK, stdin=subprocess.DEVNULL, stdout=words,
                               stderr=words)
    await_frame(job, out, 2)
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
    await_frame(job, out, 4)
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
    await_frame(job, out, 2)
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
