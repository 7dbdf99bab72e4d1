"""Breaks calls of a run with the library of faults.c, goes on without faults, and says what is wrong."""

import shutil
import signal
from dataclasses import dataclass
from pathlib import Path

from farm import CANNOT_CREATE, DONE, IO, PATIENCE, Shot, Whole, assert_begin_like, assert_same, copy

FAULTS = ["kill", "enospc", "full", "eio", "tear", "short"]
WRITES = ("write", "pwrite", "writev", "copy")

ENDS = (1002, 1003)  # last frames of the two attempts whose calls are broken


@dataclass
class Brief:
    """A short run in two attempts: what it is after the first and in the end, and the calls of both."""

    shot: Shot
    half: Path
    whole: Whole
    calls: list


def broken_calls(out):
    """The calls that were broken: what, and which file."""
    lines = Path(f"{out}.calls").read_text().splitlines()
    return [tuple(line.split()[1:3]) for line in lines if line.endswith(" broken")]


def one_of_each_kind(calls, moments):
    """A random call of each kind, by what is done to which sort of file."""
    kinds = {}
    for attempt, number, call, path in calls:
        sort = "".join(path.suffixes).translate(str.maketrans("", "", "0123456789"))
        kinds.setdefault((attempt, call, path.parent.name, sort), []).append((call, (attempt, number)))
    return [moments.choice(found) for found in kinds.values()]


def break_and_mend(brief, faults, reader, out, fault, attempt, number):
    """Breaks a call of an attempt, looks, and goes on without; returns the exit code and what is wrong."""
    shot, trouble = brief.shot, ""
    if attempt == 1:
        copy(brief.half, out)
    settings = faults(out, fault, number)
    process = shot.start(out, "--checkpoint-every", "1f", environment=settings, last=ENDS[attempt])
    code, said, broken = process.wait(PATIENCE), process.log.read_text(), broken_calls(out)
    if code not in allowed_codes(fault, broken) or (code > 0 and "Error:" not in said) or "panicked" in said:
        trouble = said[-1000:] or "not this exit code"
    try:
        if out.exists():
            assert_begin_like(reader.look(out), brief.whole.frames)
        shot.run(out, "--checkpoint-every", "1f", last=ENDS[1])
        assert_same(out, brief.whole.results)
    except AssertionError as error:
        trouble += str(error)
    return code, trouble and f"{fault} at call {number} of attempt {attempt}, {broken[:1]}: exit code {code}: {trouble}"


def allowed_codes(fault, broken):
    if not broken or fault == "short":
        return (DONE,)
    if fault in ("kill", "tear"):
        return (-signal.SIGKILL,)
    # A run goes on without its logs, where folders cannot be synced, and when something that is over cannot be removed.
    minor = all("/logs/" in path or call == "unlink" or Path(path).is_dir() for call, path in broken)
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
