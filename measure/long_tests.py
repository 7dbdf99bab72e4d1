"""Writes what the suites too long for CI found to docs/dev/measurements/test-full.md: a row for each test, of its last run.

Called by `tests/full.sh` with the log of what has run, the digest of the solver, and whether all suites did; otherwise rows
of tests that are not in the log stay as they are.
"""

import re
import sys
from pathlib import Path

from measure.page import commit, output, processor, table, today
from measure.runs import ROOT

PAGE = ROOT / "docs" / "dev" / "measurements" / "test-full.md"

HEAD = """\
# Last runs of `make test-full`

A row for each test too long for CI, of its last run. `make test-full` renews all of them, `make test-full ONLY=…` those that
it selects. The solver is a digest of the sources of `core` without comments: long shots are kept by it and go on where they were.

"""
COLUMNS = ["test", "result", "figures", "date", "commit", "solver", "machine"]


def machine():
    """Processor, cores, memory and compiler."""
    cores = output("nproc")
    memory = re.search(r"MemTotal:\s+(\d+)", Path("/proc/meminfo").read_text())
    compiler = " ".join(output("rustc", "--version").split()[:2])
    return f"{processor()}, {cores} cores, {int(memory[1]) / 2**20:.0f} GB, {compiler}"


def found(log):
    """Result and figures of every test in a log of `cargo test` and pytest."""
    results, figures = {}, {}
    for line in log.splitlines():
        if match := re.fullmatch(r"test (\S+) \.\.\. (ok|FAILED)", line):
            results[match[1]] = "passed" if match[2] == "ok" else "FAILED"
        elif match := re.match(r"(PASSED|FAILED|ERROR) (?:\S*/)?(\w+\.py::\S+)", line):
            results[match[2]] = "passed" if match[1] == "PASSED" else match[1]
        elif match := re.match(r"FIGURE (test_\S+): (.*)", line):
            figures.setdefault(match[1], []).append(match[2])
    return {name: (result, "; ".join(figures.get(name.split("::")[-1], []))) for name, result in results.items()}


def rows_of(page):
    """The rows of the page as it is, by test."""
    lines = [line for line in page.splitlines() if line.startswith("| `")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    return {row[0].strip("`"): row for row in cells if len(row) == len(COLUMNS)}


def main(log, solver, everything):
    rows = rows_of(PAGE.read_text()) if PAGE.exists() and not everything else {}
    when, where = [today(), commit()], machine()
    for name, (result, figures) in found(Path(log).read_text()).items():
        rows[name] = [f"`{name}`", result, figures.replace("|", "\\|"), *when, solver, where]
    lines = table(COLUMNS, [rows[name] for name in sorted(rows)])
    PAGE.write_text(HEAD + "\n".join(lines) + "\n")
    print(f"written: {PAGE.relative_to(ROOT)}")


main(sys.argv[1], sys.argv[2], sys.argv[3] == "all")
