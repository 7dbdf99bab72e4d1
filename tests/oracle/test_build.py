"""Output of `make build`: a program without debug tables, and the tables beside it. Also that measurements find their pages."""

import importlib
import subprocess
from pathlib import Path

import pytest

from conftest import program
from judges import ROOT

# Bytes; it has 25 million, and with its tables a hundred.
LARGEST = 40_000_000


def output(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_the_program_is_small_and_its_lines_are_found_beside_it():
    drapery = Path(program("DRAPERY", "drapery"))
    tables = Path(f"{drapery}.debug")
    assert drapery.stat().st_size < LARGEST and tables.is_file(), "build it with `make build`"
    assert ".debug_line" not in output("objdump", "--section-headers", str(drapery))
    symbols = output("nm", "--demangle", str(drapery)).splitlines()
    (address,) = [line.split()[0] for line in symbols if line.endswith(" drapery::main")]
    # Follows the link from the program, as perf, gdb and backtraces do.
    assert "cli/src/main.rs:" in output("addr2line", "--exe", str(drapery), address)


@pytest.mark.parametrize("name", ["accuracy", "plan", "ranks", "self_contact", "speed", "study", "symptoms"])
def test_every_table_of_a_measurement_has_its_place_in_a_page(name, monkeypatch):
    monkeypatch.syspath_prepend(ROOT)
    page = importlib.import_module("measure.page")
    for table in importlib.import_module(f"measure.{name}").TABLES:
        _, text, _ = page.marked(table.page, table.mark)
        for head in [line for line in text.splitlines() if line.startswith("| row |")]:
            assert head == page.table(["row", "what", *table.head, "measured"], [])[0], f"{table.page}, {table.mark}: other columns"
