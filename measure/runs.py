"""Builds of the command, and runs of scenes with what they say of themselves."""

import argparse
import atexit
import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
TODAY = Path(os.environ.get("DRAPERY", TARGET / "release" / "drapery"))
ASSETS = Path(os.environ.get("DRAPERY_ASSETS", TARGET / "release" / "drapery-assets"))
# Also as root, as in containers, and with more ranks than cores.
MPI = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMPI_MCA_rmaps_base_oversubscribe": "1",
       "OMPI_MCA_mpi_yield_when_idle": "1", "OMPI_MCA_hwloc_base_binding_policy": "none"}

# What the command line says; `__main__` fills it in.
OPTIONS = argparse.Namespace(threads=1, repeat=1, frames=0, print=False, against="336fa90")

SHORT, LONG = ('solver.integrator="semi_implicit"',), ('solver.integrator="tr_bdf2"',)

_FOLDER = Path(tempfile.mkdtemp())
atexit.register(shutil.rmtree, _FOLDER, ignore_errors=True)
_RUNS = {}


class Failed(Exception):
    """A run that ended badly: its row is left out, the others follow."""


def measured_folder():
    folder = TARGET / "measured"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def build(commit):
    """The command of a commit, with MPI, built once."""
    short = subprocess.run(["git", "rev-parse", "--short", commit], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
    built = measured_folder() / f"drapery-{short}-mpi"
    if not built.exists():
        target = measured_folder() / f"{short}-target"
        with tempfile.TemporaryDirectory() as source:
            archive = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True)
            subprocess.run(["tar", "-x", "-C", source], input=archive.stdout, check=True)
            command = ["cargo", "build", "--release", "--package", "drapery", "--features", "mpi", "--ignore-rust-version"]
            subprocess.run(command, cwd=source, check=True, env={**os.environ, "CARGO_TARGET_DIR": str(target)})
        # Under its own name at once or not at all, so that an interrupted build is made again.
        (target / "release" / "drapery").rename(built)
    return built


def assets(*arguments):
    """The folder with what `drapery-assets` makes of these arguments, made once."""
    folder = measured_folder() / "-".join(["assets", *arguments]).replace("--", "")
    if not (folder / "done").exists():
        subprocess.run([ASSETS, *arguments, "--out", str(folder)], check=True, stdout=subprocess.DEVNULL)
        (folder / "done").touch()
    return folder


class Run:
    """A run: CPU seconds of its processes, seconds by the clock, and its record; `out` is its folder. Ranks are started here, or on two
    `machines` (`tests/oracle/machines.py`)."""

    def __init__(self, program, scene, frames, settings=(), threads=1, ranks=1, machines=None):
        self.folder = Path(tempfile.mkdtemp(dir=_FOLDER))
        self.out = self.folder / "out"
        path = scene
        if not isinstance(scene, Path):
            path = self.folder / "scene.toml"
            path.write_text(scene)
        words = [program, "run", path, "--frames", f"{frames[0]}-{frames[1]}", "--threads", threads, "--progress", "none"]
        words += ["--checkpoint-every", "1000h", "--out", self.out]
        words += [f"--set={setting}" for setting in [*settings, 'output.format=["h5"]']]
        if machines:
            words = machines.mpirun(ranks, *words)
        elif ranks > 1:
            words = ["mpirun", "-n", ranks, *words]
        done, self.cpu, self.wall = timed(words)
        if done.returncode != 0:
            raise Failed(f"{shlex.join(map(str, words))}\nended with {done.returncode}\n{done.stdout}{done.stderr}")
        lines = [json.loads(line) for line in (self.out / "run.jsonl").read_text().splitlines()]
        self.frames = [line for line in lines if line["record"] == "frame" and "steps" in line]
        self.counts = lines[-1]["counts"]
        self._seconds = {stage["stage"]: stage["seconds"] for stage in lines[-1]["stages"]}
        self.steps = sum(frame["steps"] for frame in self.frames)
        print(f"  {program.name} {' '.join(settings)}: {self.cpu:.2f} CPU s, {len(self.frames)} frames, {self.steps} steps",
              file=sys.stderr, flush=True)

    def clock(self, *stages):
        """Seconds by the clock in some stages."""
        return sum(self._seconds.get(stage, 0.0) for stage in stages)

    def spent(self, *stages):
        """CPU seconds in some stages: seconds of the clock by the CPU seconds that the process took in one."""
        return self.clock(*stages) * self.cpu / self.wall

    @property
    def simulated(self):
        """CPU seconds of the simulation, without reading and writing files."""
        return self.spent("simulate")

    @property
    def stages(self):
        """Stages inside the simulation, those that took longest first."""
        inside = self._seconds.keys() - {"simulate", "read inputs", "write caches", "check caches"}
        return sorted(inside, key=lambda stage: -self._seconds[stage])

    def a_later_step(self, *names):
        """Milliseconds by the clock of a step, and counts of it, in the frames after the first: that counts the start of the run too."""
        later = self.frames[1:]
        steps = sum(frame["steps"] for frame in later)
        return [1e3 * sum(frame["seconds"] for frame in later) / steps,
                *(sum(frame["counts"].get(name, 0) for frame in later) / steps for name in names)]

    def a_frame(self, last=0):
        """CPU seconds of a frame, of all with the reading of the scene, or of the last ones alone."""
        if not last:
            return self.cpu / len(self.frames)
        return self.cpu / self.wall * sum(frame["seconds"] for frame in self.frames[-last:]) / len(self.frames[-last:])

    def worst(self, last=0):
        """CPU seconds of the slowest frame."""
        return self.cpu / self.wall * max(frame["seconds"] for frame in self.frames[-last:])

    def count(self, name):
        return self.counts.get(name, 0)

    def crossings(self):
        """Crossings of the solver's positions and of the caches, of all frames."""
        return self.count("crossings") + self.count("crossings_written")

    def retried(self):
        return sum(count for name, count in self.counts.items() if name.startswith("retried_"))

    def strain(self):
        """The largest strain of all frames, and the largest 99.9th percentile where the record has it."""
        largest = max((frame["max_strain"]["strain"] for frame in self.frames if frame.get("max_strain")), default=0.0)
        percentiles = [garment["p99_9"] for frame in self.frames for garment in frame.get("strains", [])]
        return f"{largest:.3f}" + (f" ({max(percentiles):.3f})" if percentiles else "")

    def caches(self):
        """Open caches of the garments [m], the axis Y up."""
        import h5py

        return [h5py.File(path) for path in sorted(self.out.glob("*.h5"))]


def timed(words):
    """A process that has ended, its CPU seconds with those of its children, and its seconds by the clock."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, env={**os.environ, **MPI})
    wall, after = time.monotonic() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    return done, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def alternating(scene, frames, kinds):
    """Runs of several (program, settings, threads and ranks) in turn, `--repeat` times; of each the one with the least CPU time. Runs
    that were made before are not made again."""
    last = min(frames[1], frames[0] + OPTIONS.frames) if OPTIONS.frames else frames[1]
    keys = [(program, scene, (frames[0], last), tuple(settings), *sorted(more.items())) for program, settings, more in kinds]
    tries = {}
    for _ in range(OPTIONS.repeat):
        for key, (program, settings, more) in zip(keys, kinds):
            if key not in _RUNS:
                made = Run(program, scene, (frames[0], last), settings, **{"threads": OPTIONS.threads, **more})
                tries.setdefault(key, []).append(made)
    _RUNS.update({key: min(made, key=lambda run: run.cpu) for key, made in tries.items()})
    return [_RUNS[key] for key in keys]


def run(scene, frames, settings=(), **more):
    """A run of today's build, made once."""
    return alternating(scene, frames, [(TODAY, settings, more)])[0]


def against(scene, frames, kinds):
    """Runs of today's build with settings of several kinds, after one of the earlier commit: in turn. None for a commit that does not
    read the scene."""
    earlier, today = build(OPTIONS.against), [(TODAY, settings, {}) for settings in kinds]
    try:
        return alternating(scene, frames, [(earlier, (), {}), *today])
    except Failed as trouble:
        if f"{earlier.name} run" not in str(trouble).splitlines()[0]:
            raise
        print(f"  {OPTIONS.against} does not read this: {str(trouble).splitlines()[-1]}", file=sys.stderr, flush=True)
        return [None, *alternating(scene, frames, today)]


def plan(scene, settings=()):
    """Returns the answer of `drapery plan --json` for a scene."""
    path = scene
    if not isinstance(scene, Path):
        path = Path(tempfile.mkdtemp(dir=_FOLDER)) / "scene.toml"
        path.write_text(scene)
    command = [TODAY, "plan", path, "--json", *(f"--set={setting}" for setting in settings)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
