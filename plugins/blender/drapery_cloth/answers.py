"""Answers of the command: problems of `check`, figures of `plan`, the state of `status`. Nothing here knows Blender."""

import json
import re
from dataclasses import dataclass, field

from .scene_text import object_at_line

# Exit codes (docs/guide/farm.md) that the panel explains in words of its own.
STOPPED, HOLDS_ANOTHER_RUN = 75, 73


@dataclass
class Problem:
    """Something wrong: in which object (its name in the scene file), at which frame, which vertex or face; None where unknown."""

    message: str
    help: str = ""
    object: str | None = None
    frame: int | None = None
    element: str | None = None
    index: int | None = None
    warning: bool = False


class Failed(Exception):
    """Work for a scene ends here; `problems` say why."""

    def __init__(self, *problems):
        super().__init__(problems[0].message if problems else "")
        self.problems = list(problems)


def place_of(text):
    """Object, frame, kind of element and its index, from words such as `garment "skirt", frame 1003, vertex 12`."""
    name = re.search(r'\b(?:garment|body) "([^"]*)"', text)
    frame = re.search(r"\bframe (-?\d+)", text)
    element = re.search(r"\b(vertex|point|face) (\d+)", text)
    kind = element and ("face" if element[1] == "face" else "vertex")
    return name and name[1], frame and int(frame[1]), kind, element and int(element[2])


def problems_of(errors, scene=""):
    """Problems from what the command wrote to standard error; `scene` is the text of the scene file, for excerpts of it."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", errors)
    marker = text.find("Error: ")
    if marker < 0:
        return [Problem(text.strip().splitlines()[-1])] if text.strip() else []
    text = text[marker + len("Error: ") :].strip("\n")
    if re.match(r"(a problem|\d+ problems) in the scene file", text):
        return problems_of_excerpts(text, scene)
    lines = text.splitlines()
    if re.fullmatch(r"\d+ problems", lines[0]):
        lines = lines[1:]
    problems = []
    for line in lines:
        if problems and line.startswith("  help: "):
            problems[-1].help = line[len("  help: ") :]
        elif problems and line.startswith("  ") or not line.strip():
            if problems and line.strip():
                problems[-1].message += " " + line.strip()
        else:
            problems.append(Problem(line, "", *place_of(line)))
    return problems


def problems_of_excerpts(text, scene):
    """Problems that are printed with the lines of the scene file that they are about."""
    problems = []
    for line in text.splitlines()[1:]:
        if match := re.match(r"\s*×\s(.*)", line):
            problems.append(Problem(match[1], "", *place_of(match[1])))
        elif problems and (match := re.match(r"\s*help: (.*)", line)):
            problems[-1].help = match[1]
        elif problems and (match := re.match(r".*─\[.*:(\d+):\d+\]", line)) and problems[-1].object is None:
            problems[-1].object = object_at_line(scene, int(match[1]))
    return problems


def warnings_of(answer):
    """Warnings of `check --json` or `plan --json`."""
    found = []
    for warning in json.loads(answer)["warnings"]:
        name, frame, kind, index = place_of(warning["message"])
        # The place stands in the message, or beside it as the name alone or in words, which are exact where they have an element.
        beside, at, of, number = place_of(warning["object"])
        if of is not None:
            name, frame, kind, index = beside, at, of, number
        beside = beside or warning["object"] or None
        found.append(Problem(warning["message"], warning["line"] and f"to silence it: {warning['line']}", name or beside,
                             frame, kind, index, True))
    return found


def warnings_of_log(log):
    """Returns the warnings of a run from the lines of its log.

    Messages that differ in numbers alone become one, with their count. Counts that should stay zero are left out:
    `status` has them with their totals.
    """
    found = {}
    for line in log.splitlines():
        if '"WARN"' not in line:
            continue
        try:
            message = json.loads(line)["fields"]["message"]
        except (ValueError, KeyError, TypeError):
            # The last line of a log that is being written.
            continue
        if " and should stay zero: " not in message:
            found.setdefault(re.sub(r"\d+(\.\d+)?", "0", message), []).append(message)
    return [warning_of(messages) for messages in found.values()]


def warning_of(messages):
    """One problem of warnings that differ by numbers alone; the first stands for all."""
    message, _, help = messages[0].partition("\n  help: ")
    more = f" (and {len(messages) - 1} more like it)" if len(messages) > 1 else ""
    return Problem(message + more, help, *place_of(message), True)


def plan_lines(answer):
    """Returns a few short lines for the panel from the answer of `plan --json`."""
    plan = json.loads(answer)
    lines = [f"Frames {plan['frames'][0]} to {plan['frames'][1]}"]
    for garment in plan["garments"]:
        lines.append(f"{garment['name']}: {garment['points']:,} vertices")
    lines.append(f"{len(plan['bodies'])} {'body' if len(plan['bodies']) == 1 else 'bodies'}: {', '.join(plan['bodies']) or 'none'}")
    if plan["frame"]["steps"]:
        lines.append(f"At least {plan['frame']['steps']:.0f} steps a frame")
    memory = sum(plan["bytes"].values())
    lines.append(f"Memory: {memory / 2**20:,.0f} MB" if memory >= 2**20 else "Memory: less than 1 MB")
    return lines


@dataclass
class Status:
    """Progress of a run, from `drapery status --json`.

    `state` is running, stopped, done, failed, killed, or silent: on a machine that was not heard of for minutes.
    """

    state: str
    done: int = 0
    total: int = 0
    frame: int | None = None
    seconds_left: float | None = None
    error: str = ""
    degradations: list = field(default_factory=list)

    @property
    def running(self):
        return self.state in ("running", "silent")

    @property
    def share(self):
        """Share of the frames that is done, between 0 and 1."""
        return self.done / self.total if self.total else 0.0


def status_of(answer):
    """The state of a run, from what `status --json` printed."""
    said = json.loads(answer)
    lost = [f"{each['meaning']}: {each['total']}, first at frame {each['first_frame']}" for each in said["degradations"]]
    return Status(said["state"], said["frames_done"], said["frames_total"], said["last_complete_frame"],
                  said["seconds_left"], said["error"] or "", lost)


def duration(seconds):
    """A time left as people say it."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.0f} min"
    return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60)} min"


def headline(status):
    """One line about a run."""
    if status.running:
        left = "" if status.seconds_left is None else f", {duration(status.seconds_left)} left"
        dead = "; not heard of for minutes, its machine may be lost" if status.state == "silent" else ""
        return f"{status.done} of {status.total} frames{left}{dead}"
    frames = f"{status.done} of {status.total} frames"
    return {
        "done": f"Done: {frames}",
        "stopped": f"Stopped at a checkpoint: {frames}; Continue resumes it",
        "killed": f"The process ended without a message (killed, or the disk is full): {frames} are kept; Continue resumes it",
        "failed": f"Failed: {frames} are kept",
    }.get(status.state, f"{status.state}: {frames}")
