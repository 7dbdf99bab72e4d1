"""Breaks calls of a run with the library of faults.c, goes on without faults, and says what is wrong."""

import shutil
import signal
from dataclasses import dataclass
from pathlib import Path

from farm import CANNOT_CREATE, DONE, IO, PATIENCE, Shot, Whole, assert_begin_like, assert_same, copy

FAULTS = ["kill", "enospc", "full", "eio", "tear", "short"]
WRITES = ("write", "pwrite", "writev", "copy")

# The attempts whose calls are broken: a start, one that goes on, and one that goes back; options and last frame.
ATTEMPTS = [([], 1002), ([], 1003), (["--resume", "1001"], 1003)]


@dataclass
class Brief:
    """A short run in several attempts: the folder before each of them, what it is in the end, and their calls."""

    shot: Shot
    before: list
    whole: Whole
    calls: list

    def start(self, out, attempt, environment):
        """An attempt, in its folder."""
        options, last = ATTEMPTS[attempt]
        if attempt > 0:
            copy(self.before[attempt], out)
        options = ["--checkpoint-every", "1f", "--keep", "10", *options]
        return self.shot.start(out, *options, environment=environment, last=last)

    def mend(self, out):
        """The run as it is started again and again."""
        return self.shot.run(out, "--checkpoint-every", "1f", "--keep", "10", last=ATTEMPTS[-1][1])


def broken_calls(out):
    """The calls that were broken: what, and which file."""
    lines = Path(f"{out}.calls").read_text().splitlines()
    return [tuple(line.split()[1:3]) for line in lines if line.endswith(" broken")]


def one_of_each_kind(calls, moments):
    """A random call of each kind, by what is done to which sort of file."""
    kinds = {}
    for attempt, number, call, path in calls:
        sort = "".join(path.suffixes).translate(str.maketrans("", "", "0123456789"))
        kinds.setdefault((attempt > 0, call, path.parent.name, sort), []).append((call, (attempt, number)))
    return [moments.choice(found) for found in kinds.values()]


def break_and_mend(brief, faults, reader, out, fault, attempt, number):
    """Breaks a call of an attempt, looks, and goes on without; returns the exit code and what is wrong."""
    process, trouble = brief.start(out, attempt, faults(out, fault, number)), ""
    code, said, broken = process.wait(PATIENCE), process.log.read_text(), broken_calls(out)
    if code not in allowed_codes(fault, broken) or (code > 0 and "Error:" not in said) or "panicked" in said:
        trouble = said[-1000:] or "not this exit code"
    try:
        if out.exists():
            assert_begin_like(reader.look(out), brief.whole.frames)
        brief.mend(out)
        assert_same(out, brief.whole.results)
    except AssertionError as error:
        trouble += str(error)
    return code, trouble and f"{fault} at call {number} of attempt {attempt}, {broken[:1]}: exit code {code}: {trouble}"


def allowed_codes(fault, broken):
    if not broken or fault == "short":
        return (DONE,)
    if fault in ("kill", "tear"):
        return (-signal.SIGKILL,)

    # A run goes on without its logs, where folders cannot be synced, and when something that is over cannot be removed;
    # the HDF5 library may write again what failed once. Whether the result is right is looked at in any case.
    def is_minor(call, path):
        return "/logs/" in path or call == "unlink" or path.endswith(".h5.part") or Path(path).is_dir()

    minor = all(is_minor(*one) for one in broken)
    return (DONE, IO, CANNOT_CREATE) if minor else (IO, CANNOT_CREATE)


def sweep(brief, faults, reader, tmp_path, broken):
    """Breaks calls, one a run, and says how the runs ended."""
    codes, wrong = {}, []
    for fault, (attempt, number) in broken:
        out = tmp_path / f"{fault}_{attempt}_{number}"
        code, trouble = break_and_mend(brief, faults, reader, out, fault, attempt, number)
        codes[code] = codes.get(code, 0) + 1
        wrong += [trouble] if trouble else []
        shutil.rmtree(out, ignore_errors=True)
    assert not wrong, f"{len(wrong)} of {len(broken)}\n" + "\n".join(wrong)
    return f"{len(broken)} of {len(brief.calls)} calls broken; exit codes {codes}"
