"""What the scripts that measure have in common: the machine, runs of the command, and tables of the pages in docs."""

import datetime
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCENES = ROOT / "sample_assets" / "scenes"


def output(*command):
    """What a command prints; "unknown" where it fails or is not there."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    except OSError:
        return "unknown"
    return done.stdout.strip() if done.returncode == 0 else "unknown"


def today():
    return datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d")


def commit():
    return output("git", "rev-parse", "--short", "HEAD")


def processor():
    """The processor's name."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def circumstances(command, *details):
    """A sentence about when, where and how something was measured; the load is that of now."""
    words = [f"`{command}`", today(), f"commit {commit()}", processor(), f"{os.cpu_count()} cores"]
    return ", ".join([*words, f"load {os.getloadavg()[0]:.1f}", *details]) + "."


def build(name, *features):
    """A release build of the command with other features, in a place of its own."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    subprocess.run(["cargo", "build", "--release", "--package", "drapery", *features], cwd=ROOT, check=True)
    built = target / "measured" / name
    built.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy2(target / "release" / "drapery", built)
    return built


def threads(count):
    return "one thread" if count == 1 else f"{count} threads"


def wait_for_quiet():
    """Waits until what ran before shows no more in the load of the machine, for a few minutes at most."""
    patience = time.monotonic() + 300.0
    while os.getloadavg()[0] > 0.5 and time.monotonic() < patience:
        time.sleep(5.0)


def run(command, folder):
    """Runs a shot of one process into `folder`: its record, with the CPU seconds of the process."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    after, ended = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}\nended with {done.returncode}\n{done.stdout}{done.stderr}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Record(Path(folder), cpu / (ended - started))


class Record:
    """What a run wrote about itself, and the CPU seconds of its simulation, without reading and writing files: seconds of
    its clock by the CPU seconds that the process took in one."""

    def __init__(self, folder, cpu_share):
        records = [json.loads(line) for line in (folder / "run.jsonl").read_text().splitlines()]
        frames = [record for record in records if record.get("record") == "frame"]
        self.counts = records[-1]["counts"]
        self.steps = sum(frame.get("steps", 0) for frame in frames)
        self.frames = len([frame for frame in frames if "steps" in frame])
        self._seconds = {stage["stage"]: stage["seconds"] for stage in records[-1]["stages"]}
        self._cpu_share = cpu_share
        self.cpu = self.spent(["simulate"])

    def spent(self, stages):
        """CPU seconds of some stages."""
        return self._cpu_share * sum(self._seconds.get(stage, 0.0) for stage in stages)

    def count(self, name):
        return self.counts.get(name, 0)

    def crossings(self):
        """Crossings of the solver's positions and of the caches, of all frames."""
        return self.count("crossings") + self.count("crossings_written")


def without_tables(text, tables):
    """A scene without some of its top tables."""
    kept, inside = [], False
    for line in text.splitlines(keepends=True):
        if line.startswith("["):
            inside = line.split("#")[0].strip().strip("[]") in tables
        if not inside:
            kept.append(line)
    return "".join(kept)


def scene_file(scene, left_out, folder):
    """The path of a sample scene; without some of its tables, of a copy in `folder`."""
    path = SCENES / f"{scene}.toml"
    if not left_out:
        return path
    # These scenes read no files, so they may lie anywhere.
    copy = Path(folder) / f"{scene}.toml"
    copy.write_text(without_tables(path.read_text(), left_out))
    return copy


def table(head, rows):
    """The lines of a table."""
    return ["| " + " | ".join(str(cell) for cell in cells) + " |" for cells in [head, ["---"] * len(head), *rows]]


def write(page, mark, lines):
    """Puts lines between a mark of a page and its end; the page is read now, as it may have been edited meanwhile."""
    begin, end = f"<!-- measured: {mark} -->\n", "<!-- end -->"
    head, found, rest = page.read_text().partition(begin)
    _, closed, tail = rest.partition(end)
    if not found or not closed:
        sys.exit(f"{page}: it lacks {begin.strip()} … {end}")
    page.write_text(head + begin + "\n".join(lines) + "\n" + end + tail)
    print(f"written: {page.relative_to(ROOT)}, {mark}", flush=True)
