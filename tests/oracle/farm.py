"""Runs that are stopped, killed and continued, and a reader that looks at their files in the meantime.

    python farm.py

is the reader: it takes a folder or a file a line and answers with a JSON line. A process of its own, because a broken
archive may bring the official Alembic library down.
"""

import hashlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from judges import ROOT

# The same program as in conftest.py, which makes sure that it is there.
DRAPERY = os.environ.get("DRAPERY", str(ROOT / "target" / "release" / "drapery"))

# Exit codes.
DONE, BAD_INPUT, MISSING_INPUT, CANNOT_CREATE, IO, STOPPED, BAD_SCENE = 0, 65, 66, 73, 74, 75, 78

# Bytes at the beginning of a checkpoint that hold length and hash of the rest.
SEAL = 512

# A wait that is longer than this is a hang [s]. No verdict may depend on how fast or how loaded the machine is, so this is
# far beyond what any test needs.
PATIENCE = 1200.0


class Shot:
    """A scene with its frames, as a farm starts it again and again with the same command."""

    def __init__(self, scene, frames, **parameters):
        self.scene, self.parameters = scene, parameters
        self.first, self.last = map(int, frames.split("-"))

    def frames(self, last=None):
        return f"{self.first}-{self.last if last is None else last}"

    def command(self, out, *options, last=None, threads=2):
        line = [DRAPERY, "run", str(self.scene), "--frames", self.frames(last), "--out", str(out)]
        line += ["--threads", str(threads), "--progress", "none", *map(str, options)]
        for name, value in self.parameters.items():
            line += ["--set", f"{name}={value}"]
        return line

    def start(self, out, *options, environment=None, **how):
        """The run in the background; what it says goes into a file beside its folder."""
        log = Path(f"{out}.words")
        with log.open("a") as words:
            process = subprocess.Popen(self.command(out, *options, **how), stdin=subprocess.DEVNULL, stdout=words,
                                       stderr=words, env=os.environ | (environment or {}))
        process.log = log
        return process

    def run(self, out, *options, code=DONE, environment=None, **how):
        """The run to its end, which has to be the exit code `code`; returns what it said."""
        command = self.command(out, *options, **how)
        done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL,
                              env=os.environ | (environment or {}))
        said = done.stdout + done.stderr
        assert done.returncode == code, f"exit code {done.returncode} of {' '.join(command)}\n{said[-4000:]}"
        return said


@dataclass
class Whole:
    """A run that nobody disturbs, with a checkpoint of every frame."""

    out: Path
    results: dict
    frames: dict
    seconds: float


def wait_until(happens, process, what):
    """Waits until something happens in a run; false if the run ends before."""
    deadline = time.monotonic() + PATIENCE
    while not happens():
        if process.poll() is not None:
            return bool(happens())
        assert time.monotonic() < deadline, f"waited {PATIENCE} s in vain until {what}"
        time.sleep(0.002)
    return True


def holds_folder(out, process):
    """Whether the run has the lock of its folder; from then on it hears signals."""
    lock = Path(out) / "lock.json"
    mine = f'"pid":{process.pid},'
    return wait_until(lambda: lock.exists() and mine in lock.read_text(), process, "the folder is taken")


def manifest(out):
    try:
        return json.loads((Path(out) / "manifest.json").read_text())
    except FileNotFoundError:
        return {}


def reaches(out, process, frame):
    """Waits until a run has finished a frame; false if the run ends before."""
    def has_frame():
        return (manifest(out).get("last_complete_frame") or -1) >= frame

    return wait_until(has_frame, process, f"frame {frame} is done")


class Moments:
    """Random moments in a run by what it has done, not by the clock: the machine may be faster or slower at any time."""

    def __init__(self, seed, shot, seconds):
        self._random = random.Random(seed)
        self._first = shot.first
        self._frame_seconds = seconds / (shot.last - shot.first + 1)

    def wait(self, out, process, part_of_start=0.0):
        """Waits until a run has finished none to four frames more than it had, and for a random part of a frame.

        With the probability `part_of_start` it does not even wait until the run has begun.
        """
        if self._random.random() >= part_of_start:
            done = manifest(out).get("last_complete_frame")
            more, done = self._random.randint(0, 4), self._first - 1 if done is None else done
            if not (holds_folder(out, process) if more == 0 else reaches(out, process, done + more)):
                return
        time.sleep(self._frame_seconds * self._random.random())


def stop(process, signal):
    """Sends a signal and waits for the end; returns exit code and seconds."""
    begin = time.monotonic()
    process.send_signal(signal)
    code = process.wait(PATIENCE)
    return code, time.monotonic() - begin


def caches(out):
    return {path.name: path for path in sorted(Path(out).iterdir()) if path.suffix in (".abc", ".h5")}


def checkpoints(out):
    """The checkpoints of a run, earliest first."""
    return sorted((Path(out) / "checkpoints").glob("frame_*.h5"))


def results(out):
    """Everything of a run that has to be the same bytes: the caches and the checkpoint of the last frame."""
    found = {name: path.read_bytes() for name, path in caches(out).items()}
    last = checkpoints(out)[-1]
    return found | {last.name: last.read_bytes()}


def assert_same(out, expected):
    """The run is done, and its caches and last checkpoint are those of another one, byte for byte."""
    found = results(out)
    assert found.keys() == expected.keys(), f"{out}: {sorted(found)} instead of {sorted(expected)}"
    differing = [name for name in expected if found[name] != expected[name]]
    assert not differing, f"{out}: {differing} differ from those of the run that nobody disturbed"
    assert manifest(out)["state"] == "done", f"{out}: {manifest(out)}"
    # What a starter that was killed had prepared may stay: it could be that of a starter elsewhere. So may a copy for
    # `stale` of a run that has all its frames and finds nothing to do: the next attempt that writes removes it.
    may_stay = [".lock.json.", "attempt_"]
    left = [str(path) for path in Path(out).rglob("*.part") if not path.name.startswith(tuple(may_stay))]
    assert not left, f"unfinished files are left: {left}"


def contents(out):
    """Name, bytes and time of change of all files in a folder."""
    files = (path for path in sorted(Path(out).rglob("*")) if path.is_file())
    return {str(path): (path.read_bytes(), path.stat().st_mtime_ns) for path in files}


def copy(out, to):
    shutil.copytree(out, to)
    return to


class Reader:
    """Process that reads the folder of a run with the official Alembic library and h5py."""

    def __init__(self):
        command = [sys.executable, str(Path(__file__).resolve())]
        # Not in the project's folder, as in `judges.ask`.
        self.process = subprocess.Popen(command, cwd="/", text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        stderr=subprocess.PIPE)

    def look(self, out):
        """Digests of the frames of each file, by its name relative to the folder."""
        self.process.stdin.write(f"{Path(out).resolve()}\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, f"the reader died of {out}: {self.process.wait()} {self.process.stderr.read()[-2000:]}"
        answer = json.loads(line)
        refused = {name: found for name, found in answer.items() if isinstance(found, str)}
        assert not refused, f"in {out}: {refused}"
        return answer

    def close(self):
        self.process.communicate()


def assert_begin_like(found, whole):
    """Asserts that the caches found of a run in progress are the beginning of the whole run; returns the frames in each."""
    lengths = []
    for name, digests in found.items():
        if name in whole and "/" not in name:
            assert digests == whole[name][: len(digests)], f"{name} does not begin like the whole run"
            lengths.append(len(digests))
    return lengths


def digest(*arrays):
    return hashlib.sha1(b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)).hexdigest()


def read_archive(path):
    from alembic3d import Abc  # of the reader alone: the tests' own process must outlive a broken archive

    from official_alembic import choose

    archive = Abc.IArchive(str(path))
    schema = choose(archive, None).getSchema()
    frames = []
    velocities = schema.getVelocitiesProperty()
    for position, velocity in zip(schema.getPositionsProperty().samples, velocities.samples):
        frames.append(digest(np.array(position), np.array(velocity)))
    return frames


def read_cache(path):
    with h5py.File(path, "r") as file:
        committed = file["committed"][:]
        frames = [digest(*both) for both in zip(file["positions"][:], file["velocities"][:])]
    # Opened anew: what was cut back in the meantime is not there.
    with h5py.File(path, "r") as file:
        committed = committed & file["committed"][:]
    count = int(committed.sum())
    assert all(committed[:count]), f"gaps between the frames: {committed}"
    return frames[:count]


def read_checkpoint(path):
    whole = path.read_bytes()
    seal = f"bytes {len(whole)}\nsha256 {hashlib.sha256(whole[SEAL:]).hexdigest()}\n"
    assert seal.encode() in whole[:SEAL], "the seal is not that of the content"
    with h5py.File(path, "r") as file:
        return [digest(file["state"]["positions"], file["state"]["velocities"])]


def read_json(path):
    json.loads(path.read_text())
    return []


def readers(out):
    """Every file under a final name, with what reads it."""
    for path in sorted(out.rglob("*")):
        if path.name.startswith(".") or any(name.endswith(".part") for name in path.parts) or not path.is_file():
            continue
        if path.suffix == ".abc":
            yield path, read_archive
        elif path.suffix == ".h5":
            yield path, read_checkpoint if path.name.startswith("frame_") else read_cache
        elif path.suffix == ".json" and path.name != "lock.json":
            yield path, read_json


def is_still(path, held):
    """Whether the name still stands for the file that is held open, so that its number cannot be given to another."""
    try:
        return path.stat().st_ino == os.fstat(held.fileno()).st_ino
    except FileNotFoundError:
        return False


def look(out):
    answer = {}
    for path, read in readers(out):
        name = str(path.relative_to(out))
        # Checkpoints are pruned and caches set aside while somebody looks: what is another file now is looked at again.
        while True:
            try:
                held = path.open("rb")
            except FileNotFoundError:
                answer.pop(name, None)
                break
            with held:
                try:
                    answer[name] = read(path)
                    break
                except Exception as error:  # whatever goes wrong in a reader is what the test wants to hear
                    answer[name] = f"{type(error).__name__}: {error}"
                    if is_still(path, held):
                        break
    return answer


def main():
    for line in sys.stdin:
        print(json.dumps(look(Path(line.strip()))), flush=True)


if __name__ == "__main__":
    main()
