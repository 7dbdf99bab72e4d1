"""Tables of the pages in docs, between a mark and its end; the text around them stays as it is."""

import datetime
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from measure.runs import OPTIONS, ROOT


def output(*command):
    """Output of a command; "unknown" where it fails or is not there."""
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
    """The processor's name, without trade marks: a table's cells are narrow."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    name = next((line.split(":")[1] for line in lines if line.startswith("model name")), platform.machine())
    return " ".join(re.sub(r"\((R|TM)\)|\bProcessor\b|\bCPU\b|@", " ", name).split())


def circumstances():
    """When, where and how something was measured; the load is that of now."""
    words = [today(), commit(), processor(), f"load {os.getloadavg()[0]:.1f}"]
    words += [f"{OPTIONS.threads} threads"] if OPTIONS.threads > 1 else []
    words += [f"fastest of {OPTIONS.repeat}"] if OPTIONS.repeat > 1 else []
    return ", ".join(words + ([f"at most {OPTIONS.frames} frames"] if OPTIONS.frames else []))


def table(head, rows):
    """The lines of a table."""
    return ["| " + " | ".join(str(cell) for cell in cells) + " |" for cells in [head, ["---"] * len(head), *rows]]


def marked(page, mark):
    """The text before a mark of a page, between it and its end, and after; as the page is now, which may be edited meanwhile."""
    begin, end = f"<!-- measured: {mark} -->\n", "<!-- end -->"
    head, found, rest = (ROOT / "docs" / page).read_text().partition(begin)
    between, closed, tail = rest.partition(end)
    if not found or not closed:
        sys.exit(f"docs/{page}: it lacks {begin.strip()} … {end}")
    return head + begin, between, end + tail


def write(page, mark, lines):
    """Puts lines between a mark and its end."""
    before, _, after = marked(page, mark)
    (ROOT / "docs" / page).write_text(before + "\n".join(lines) + "\n" + after)
    print(f"written: docs/{page}, {mark}", flush=True)


@dataclass
class Table:
    """A table of a page: its columns, and by name its rows, each with what it is and the function that measures it. A function returns
    the cells of one line or of several."""

    page: str
    mark: str
    head: list
    rows: dict

    def measure(self, name):
        """Measures a row, and puts it into the page; rows of other names stay, those that are measured no more behind all others."""
        what, function = self.rows[name]
        lines = function()
        lines = lines if isinstance(lines[0], list) else [lines]
        head = ["row", "what", *self.head, "measured"]
        found = [[f"`{name}`", what, *line, circumstances()] for line in lines]
        if OPTIONS.print:
            print("\n".join(table(head, found)), flush=True)
            return
        _, text, _ = marked(self.page, self.mark)
        kept = {name: table(head, found)[2:]}
        for line in text.splitlines():
            of = line.split("|")[1].strip(" `") if line.startswith("| `") else ""
            if of != name:
                kept.setdefault(of, []).append(line)
        names = [*self.rows, *(known for known in kept if known and known not in self.rows)]
        write(self.page, self.mark, table(head, []) + [line for known in names for line in kept.get(known, [])])


@dataclass
class Block:
    """A text of a page that is made as a whole, with a line in front that says when and where."""

    page: str
    mark: str
    what: str
    make: callable

    @property
    def rows(self):
        return {self.mark: (self.what, self.make)}

    def measure(self, name):
        lines = [f"{circumstances()}.", "", *self.make()]
        print("\n".join(lines)) if OPTIONS.print else write(self.page, self.mark, lines)
