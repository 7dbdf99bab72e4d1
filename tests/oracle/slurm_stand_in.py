"""A stand-in for Slurm: runs a batch script on this machine and delivers what Slurm would deliver.

It is not Slurm, on which the same script runs in test_slurm.py; it takes a second, and needs nothing installed. It knows the options that docs/guide/farm/slurm.sbatch uses, as sbatch(1) describes them: `--signal=B:SIG@s`
(to the shell alone), `--requeue`, `--open-mode`; the variables SLURM_JOB_ID, SLURM_JOB_NAME, SLURM_RESTART_COUNT,
SLURM_CPUS_PER_TASK and SLURM_JOB_END_TIME; (of newer versions, Debian 12's has it not) and `scontrol requeue`. There is no queue, and no time limit passes: a test
says at which frame the notice comes, the job is cancelled or preempted, or the machine fails. A script may take its time to end, too:
Slurm would kill it after the seconds that it asked for, but here the machine may be loaded.
"""

import json
import os
import re
import signal
import subprocess
import time

from farm import PATIENCE

JOB = "4711"

# After these Slurm starts a job again by itself.
BY_SLURM = ("node failure", "preemption")


def frame_of(out):
    """Last frame that is complete in the caches of a run, or None."""
    try:
        return json.loads((out / "manifest.json").read_text())["last_complete_frame"]
    except (OSError, ValueError):
        return None


def wait_for_frame(out, frame, process):
    """Waits until a run has written a frame."""
    deadline = time.monotonic() + PATIENCE
    while (frame_of(out) or -1) < frame:
        assert process.poll() is None, f"it ended with {process.returncode} before frame {frame}"
        assert time.monotonic() < deadline, f"frame {frame} does not come"
        time.sleep(0.003)


def make_foreign(out, silent_for):
    """Makes the lock in a folder that of a process on another machine, last heard of `silent_for` seconds ago."""
    lock = out / "lock.json"
    owner = json.loads(lock.read_text())
    owner.update(host="another-machine", boot="another-boot", heartbeat=int(time.time()) - silent_for)
    lock.write_text(json.dumps(owner))


class Slurm:
    """One job from its submission to its end."""

    def __init__(self, script, folder):
        self.script, self.folder = script, folder
        self.options = dict(re.findall(r"^#SBATCH --([a-z-]+)(?:=(\S+))?$", script.read_text(), re.MULTILINE))
        self.starts = []  # what ended each start: an exit code, or one of BY_SLURM
        self.requests = folder / "scontrol.txt"
        commands = folder / "commands"
        commands.mkdir()
        (commands / "scontrol").write_text(f'#!/bin/sh\n[ "$1" = show ] || echo "$*" >> "{self.requests}"\n')
        (commands / "scontrol").chmod(0o755)
        self.commands = commands

    @property
    def log(self):
        """File of the job's output."""
        return self.folder / self.options["output"].replace("%x", "shot").replace("%j", JOB)

    def run(self, out, arguments, events):
        """Runs the job; `events` tells what happens to each start: a kind and the frame at which it comes.

        Kinds are "notice", "cancel", "preemption" and "node failure"; the last start is left alone. Returns the job's exit code.
        """
        for number in range(len(events) + 1):
            event, frame = events[number] if number < len(events) else (None, None)
            code = self._start(number, out, arguments, event, frame)
            self.starts.append(code)
            if event == "preemption":
                self.starts[-1] = event
            if self.starts[-1] not in BY_SLURM and not self._requeued(number):
                return code
            assert "requeue" in self.options, "Slurm starts only jobs with --requeue again"
        raise AssertionError("the job was started again after the last event")

    def _requeued(self, number):
        """Whether the script has asked for another start."""
        asked = self.requests.read_text().splitlines() if self.requests.exists() else []
        assert all(line == f"requeue {JOB}" for line in asked), asked
        return len(asked) > sum(code not in BY_SLURM for code in self.starts[:number])

    def _environment(self, number):
        environment = dict(os.environ)
        environment.update(
            PATH=f"{self.commands}:{environment['PATH']}",
            SLURM_JOB_ID=JOB,
            SLURM_JOB_NAME="shot",
            SLURM_CPUS_PER_TASK="2",
            SLURM_JOB_END_TIME=str(int(time.time()) + 3600),
        )
        if number:
            environment["SLURM_RESTART_COUNT"] = str(number)
        return environment

    def _start(self, number, out, arguments, event, frame):
        mode = "ab" if self.options.get("open-mode") == "append" else "wb"
        with open(self.log, mode) as log:
            process = subprocess.Popen(
                ["bash", str(self.script), str(out), *arguments], cwd=self.folder, env=self._environment(number),
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
            try:
                if event is None:
                    return process.wait(PATIENCE)
                wait_for_frame(out, frame, process)
                if event == "node failure":
                    os.killpg(process.pid, signal.SIGKILL)
                    process.wait()
                    make_foreign(out, silent_for=20)
                    return "node failure"
                self._notify(process, event)
                return process.wait(PATIENCE)
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)

    def _notify(self, process, event):
        """Sends the signal of a notice, to the shell alone if the script says so, or of the end of a job, to all of its processes."""
        to_shell, name = re.match(r"(B:)?(\w+)(?:@\d+)?$", self.options["signal"]).groups()
        if event != "notice":
            os.killpg(process.pid, signal.SIGTERM)
        elif to_shell:
            os.kill(process.pid, getattr(signal, f"SIG{name}"))
        else:
            os.killpg(process.pid, getattr(signal, f"SIG{name}"))
