"""The scripts of docs/guide/farm for Slurm, submitted to Slurm: Debian's, on this machine."""

import json
import os
import signal
import subprocess
import tempfile

import pytest

import slurm
from conftest import program
from farm import PATIENCE, assert_same, manifest, results
from judges import ROOT

FARM = ROOT / "docs" / "guide" / "farm"
SCENE = ROOT / "sample_assets" / "scenes" / "hanging_sheet.toml"
FIRST, LAST = 1001, 1030
ARGUMENTS = [SCENE, "--frames", f"{FIRST}-{LAST}"]
# Longer, on fast machines too, than the grace time of a preempted job, and than the least time limit of a job with its notice.
SHORT, LONG = 130, 180

pytestmark = pytest.mark.full


@pytest.fixture(scope="module")
def cluster():
    lacking = slurm.missing()
    if lacking or os.geteuid() != 0:
        pytest.skip(f"not root, or not installed: {', '.join(lacking)} (Debian: slurm-wlm, munge)")
    os.environ["DRAPERY"] = program("DRAPERY", "drapery")
    os.environ.pop("DRAPERY_PROGRESS", None)
    # munged wants every user to be able to reach its socket, which the folders of pytest do not allow.
    with tempfile.TemporaryDirectory(prefix="slurm-") as folder, slurm.Cluster(folder) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def whole(run_scene):
    """Files of a run that nobody disturbs."""
    return results(run_scene(str(SCENE), f"{FIRST}-{LAST}", resolution=SHORT))


def sized(resolution):
    return ["--set", f"resolution={resolution}"]


def submit(cluster, out, *arguments, options=()):
    """Number of the job of a shot, and the file of its log."""
    options = ["--job-name=shot", "--cpus-per-task=2", *options]
    job = cluster.submit(FARM / "slurm.sbatch", out, *ARGUMENTS, *arguments, options=options, folder=out.parent)
    return job, out.parent / f"shot.{job}.log"


def wait_for_frame(cluster, out, frame):
    cluster.wait_until(lambda: (manifest(out).get("last_complete_frame") or 0) >= frame, f"frame {frame}")


def ends(out):
    return [attempt.get("end") for attempt in manifest(out)["attempts"]]


def test_a_job_whose_time_is_over_goes_on_until_the_shot_is_done(cluster, run_scene, tmp_path):
    out = tmp_path / "out"
    # Slurm sends the notice up to a minute early.
    job, log = submit(cluster, out, *sized(LONG), options=["--time=2", "--signal=B:USR1@20"])
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["ExitCode"]) == ("COMPLETED", "0:0"), log.read_text()[-2000:]
    assert int(end["Restarts"]) == len(ends(out)) - 1 > 0
    # The notice, or the end of the job in the environment of newer versions.
    assert set(ends(out)[:-1]) <= {"signal USR1", "job-end"} and ends(out)[-1] == "done", ends(out)
    assert {attempt["threads"] for attempt in manifest(out)["attempts"]} == {2}
    # One log, continued.
    assert f"frame {FIRST}/{LAST}" in log.read_text() and f"frame {LAST}/{LAST}" in log.read_text()
    assert_same(out, results(run_scene(str(SCENE), f"{FIRST}-{LAST}", resolution=LONG)))


def preempt(cluster):
    cluster.ask("sbatch", "--partition=urgent", "--exclusive", "--output=/dev/null", "--wrap=sleep 1")


def test_a_preempted_job_writes_a_checkpoint_and_slurm_starts_it_again(cluster, whole, tmp_path):
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT))
    wait_for_frame(cluster, out, FIRST + 2)
    # The shell of a job is told at the end of the grace time.
    preempt(cluster)
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("COMPLETED", "1"), log.read_text()[-2000:]
    assert "DUE TO PREEMPTION" in log.read_text()
    assert ends(out) == ["signal TERM", "done"]
    assert_same(out, whole)


def test_ranks_that_are_preempted_stop_in_the_grace_time_and_the_job_asks_for_another_start(cluster, whole, tmp_path):
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT), options=["--ntasks=2", "--cpus-per-task=1"])
    wait_for_frame(cluster, out, FIRST + 2)
    # A step is told at once.
    preempt(cluster)
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("COMPLETED", "1"), log.read_text()[-2000:]
    assert "DUE TO PREEMPTION" not in log.read_text()
    assert ends(out) == ["signal TERM", "done"] and manifest(out)["attempts"][-1]["ranks"] == 2
    assert_same(out, whole)


def test_a_job_that_a_wrangler_requeues_goes_on(cluster, whole, tmp_path):
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT))
    wait_for_frame(cluster, out, FIRST + 5)
    cluster.ask("scontrol", "requeue", job)
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("COMPLETED", "1"), log.read_text()[-2000:]
    assert ends(out) == ["signal TERM", "done"]
    assert_same(out, whole)


def test_a_cancelled_job_writes_a_checkpoint_and_the_next_one_goes_on(cluster, whole, tmp_path):
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT))
    wait_for_frame(cluster, out, FIRST + 5)
    cluster.ask("scancel", job)
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("CANCELLED", "0")
    cluster.wait_until(lambda: "stopped (signal TERM)" in log.read_text(), "its last line")
    job, log = submit(cluster, out, *sized(SHORT))
    assert cluster.wait_for_end(job)["JobState"] == "COMPLETED", log.read_text()[-2000:]
    assert ends(out) == ["signal TERM", "done"]
    assert_same(out, whole)


def test_a_job_whose_machine_failed_is_started_again_and_takes_its_lock_over(cluster, whole, tmp_path):
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT), "--checkpoint-every", "5f")
    wait_for_frame(cluster, out, FIRST + 12)
    cluster.lose_node()
    cluster.wait_until(lambda: cluster.job(job)["JobState"] != "RUNNING", "Slurm notices")
    cluster.start_node()
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("COMPLETED", "1"), log.read_text()[-2000:]
    assert ends(out) == [None, "done"] and manifest(out)["attempts"][-1]["first_frame"] > FIRST
    assert_same(out, whole)


def test_a_job_that_loses_a_rank_asks_for_another_start(cluster, whole, tmp_path, monkeypatch):
    monkeypatch.setitem(cluster.environment, "DRAPERY_RANK_TIMEOUT", "2s")
    out = tmp_path / "out"
    job, log = submit(cluster, out, *sized(SHORT), "--checkpoint-every", "5f", options=["--ntasks=2", "--cpus-per-task=1"])
    wait_for_frame(cluster, out, FIRST + 12)
    first = manifest(out)["attempts"][0]["pid"]
    other = [pid for pid in cluster.processes(job) if pid != first and words(pid)[:2] == [os.environ["DRAPERY"], "run"]]
    assert len(other) == 1, other
    os.kill(other[0], signal.SIGSTOP)
    end = cluster.wait_for_end(job)
    assert (end["JobState"], end["Restarts"]) == ("COMPLETED", "1"), log.read_text()[-2000:]
    assert "sent no heartbeat" in log.read_text() and ends(out) == ["failed", "done"]
    assert_same(out, whole)


def words(pid):
    with open(f"/proc/{pid}/cmdline") as line:
        return line.read().split("\0")


def submit_chunks(cluster, folder, *arguments):
    command = ["bash", FARM / "slurm_chunks.sh", "shot", "10", folder / "out", SCENE, f"{FIRST}-{LAST}", *arguments]
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, timeout=PATIENCE,
                          env=cluster.environment | {"SBATCH": "sbatch --cpus-per-task=2"})
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


def test_chunks_follow_each_other_with_a_log_each(cluster, whole, tmp_path):
    jobs = submit_chunks(cluster, tmp_path, *sized(SHORT))
    assert [cluster.wait_for_end(job)["JobState"] for job in jobs] == ["COMPLETED"] * 3
    for number, job in enumerate(jobs):
        first, last = FIRST + 10 * number, FIRST + 10 * number + 9
        log = (tmp_path / f"shot.{first}-{last}.{job}.log").read_text()
        assert f"frame {first}/{last}" in log and f"frame {last}/{last}" in log and f"frame {last + 1}/" not in log
    assert [attempt["first_frame"] for attempt in manifest(tmp_path / "out")["attempts"]] == [FIRST, FIRST + 10, FIRST + 20]
    assert_same(tmp_path / "out", whole)


def test_a_chunk_that_fails_ends_the_chain(cluster, tmp_path):
    jobs = submit_chunks(cluster, tmp_path, "--set", "resolution=none")
    first, *others = [cluster.wait_for_end(job) for job in jobs]
    assert (first["JobState"], first["ExitCode"]) == ("FAILED", "78:0")
    assert {other["JobState"] for other in others} == {"CANCELLED"}


def test_a_board_of_all_shots_is_one_call(cluster, tmp_path):
    """One job runs, another one was cancelled."""
    running, stopped = tmp_path / "running", tmp_path / "stopped"
    job, _ = submit(cluster, stopped, *sized(SHORT))
    wait_for_frame(cluster, stopped, FIRST + 3)
    cluster.ask("scancel", job)
    cluster.wait_for_end(job)
    job, _ = submit(cluster, running, *sized(LONG))
    wait_for_frame(cluster, running, FIRST + 3)
    done = subprocess.run([os.environ["DRAPERY"], "status", running, stopped, "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    one, other = map(json.loads, done.stdout.splitlines())
    assert (one["state"], one["host"].split(".")[0], one["end"]) == ("running", cluster.host, None) and one["eta"].endswith("UTC")
    assert (other["state"], other["end"], other["eta"]) == ("stopped", "signal TERM", None)
    cluster.ask("scancel", job)
    cluster.wait_for_end(job)
