"""A Slurm of one machine, from Debian's packages `slurm-wlm` and `munge`: its daemons in a folder of their own, no service of the system.

Two partitions share the machine: jobs of `urgent` preempt those of `shots`, which Slurm then puts back into the queue.
"""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

from farm import PATIENCE

DAEMONS = ("munged", "slurmctld", "slurmd")
# Where Debian has daemons; the path of a user does not always hold it.
SYSTEM = "/usr/sbin"

# A preempted job has GraceTime seconds before it is told to end, and every job KillWait seconds between SIGTERM and SIGKILL. A requeued
# job waits for `cred_expire` before it starts again (Slurm's default is two minutes).
SETTINGS = """\
ClusterName=one_machine
SlurmctldHost={host}
SlurmctldPort={controller_port}
SlurmdPort={node_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
ReturnToService=2
SlurmdTimeout=10
KillWait=30
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
SchedulerParameters=sched_interval=2,batch_sched_delay=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={processors} State=UNKNOWN
PartitionName=shots Nodes={host} Default=YES PriorityTier=1 GraceTime=8
PartitionName=urgent Nodes={host} PriorityTier=2
"""


def missing():
    """Daemons that are not installed."""
    return [name for name in DAEMONS if not shutil.which(name, path=SYSTEM)]


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


class Cluster:
    """Controller, node and the daemon that signs their messages; `with` starts and ends them."""

    def __init__(self, folder):
        self.folder = Path(folder)
        for name in ("state", "spool"):
            (self.folder / name).mkdir(parents=True)
        self.folder.chmod(0o755)
        self.host = socket.gethostname().split(".")[0]
        settings = SETTINGS.format(folder=self.folder, host=self.host, user="root", processors=os.cpu_count(),
                                   controller_port=free_port(), node_port=free_port())
        (self.folder / "slurm.conf").write_text(settings)
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        self.environment = dict(os.environ, SLURM_CONF=str(self.folder / "slurm.conf"))
        self.daemons = {}

    def __enter__(self):
        try:
            files = {name: str(self.folder / f"munge.{name}") for name in ("key", "socket", "pid", "log", "seed")}
            self.start("munged", "--foreground", f"--key-file={files['key']}", f"--socket={files['socket']}",
                       f"--pid-file={files['pid']}", f"--log-file={files['log']}", f"--seed-file={files['seed']}")
            self.wait_until(lambda: Path(files["socket"]).exists(), "munged answers")
            self.start("slurmctld", "-D", "-f", str(self.folder / "slurm.conf"))
            self.start_node()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        with contextlib.suppress(Exception):
            self.ask("scancel", "--user", "root")
            self.wait_until(lambda: not self.ask("squeue", "--noheader"), "jobs have ended", 60)
        for name in reversed(DAEMONS):
            self.end(name)

    def start(self, name, *arguments):
        """Starts a daemon in the foreground, with what it says in a file."""
        with (self.folder / f"{name}.words").open("a") as words:
            self.daemons[name] = subprocess.Popen([f"{SYSTEM}/{name}", *arguments], env=self.environment, stdout=words,
                                                  stderr=words, stdin=subprocess.DEVNULL, start_new_session=True)

    def end(self, name, how=signal.SIGTERM):
        daemon = self.daemons.pop(name, None)
        if daemon and daemon.poll() is None:
            daemon.send_signal(how)
            daemon.wait(PATIENCE)

    def start_node(self):
        """Starts the daemon of the node, and waits until the controller has it."""
        self.start("slurmd", "-D", "-f", str(self.folder / "slurm.conf"), "-N", self.host)
        self.wait_until(lambda: self.ask("sinfo", "--noheader", "--format=%t").startswith(("idle", "mix", "alloc")), "the node is up")

    def lose_node(self):
        """Ends the daemon of the node and all processes of its jobs, as a power cut does."""
        processes = [pid for job in self.ask("squeue", "--noheader", "--states=R", "--format=%i").split()
                     for pid in self.processes(job)]
        self.end("slurmd", signal.SIGKILL)
        for pid in processes:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def processes(self, job):
        """Processes of a job: its shell, what that has started, and Slurm's own that watches over them."""
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
                variables = (entry / "environ").read_bytes().split(b"\0")
                if f"slurmstepd: [{job}." in words or f"SLURM_JOB_ID={job}".encode() in variables:
                    found.append(int(entry.name))
        return found

    def ask(self, *command):
        """Runs a command of Slurm, and returns what it prints."""
        done = subprocess.run(command, capture_output=True, text=True, env=self.environment, timeout=PATIENCE)
        assert done.returncode == 0, f"{' '.join(command)}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def submit(self, script, *arguments, options=(), folder=None):
        """Number of the job that runs a script."""
        command = ["sbatch", "--parsable", *options, str(script), *map(str, arguments)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=self.environment, timeout=PATIENCE)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    def job(self, number):
        """Slurm's record of a job, as `scontrol show job` prints it."""
        words = self.ask("scontrol", "--oneliner", "show", "job", number)
        return dict(word.split("=", 1) for word in words.split() if "=" in word)

    def wait_for_end(self, number):
        """The record of a job that has ended."""
        ended = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "PREEMPTED", "OUT_OF_MEMORY", "DEADLINE")
        self.wait_until(lambda: self.job(number)["JobState"] in ended, f"job {number} ends")
        return self.job(number)

    def wait_until(self, holds, what, patience=PATIENCE):
        deadline = time.monotonic() + patience
        while not holds():
            for name, daemon in self.daemons.items():
                assert daemon.poll() is None, f"{name} has ended:\n{(self.folder / f'{name}.words').read_text()[-3000:]}"
            assert time.monotonic() < deadline, f"not yet: {what}"
            time.sleep(0.2)
