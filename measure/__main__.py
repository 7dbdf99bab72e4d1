"""python -m measure NAME [--rows A,B] [--list] [--print] [--repeat N] [--threads N] [--frames N] [--against COMMIT]"""

import argparse
import importlib
import subprocess
import sys

from measure import runs

NAMES = {
    "speed": "CPU seconds a frame beside an earlier commit, both integrators; writes dev/measurements/speed.md",
    "plan": "how far the cost that `drapery plan` expects is from that of simulated frames; writes dev/measurements/speed.md",
    "accuracy": "what repulsion with history, integrators, presets and friction cost and bring; writes dev/measurements/accuracy.md",
    "self_contact": "what self-contact costs; writes dev/measurements/self-contact.md",
    "ranks": "what many ranks cost and bring; writes dev/measurements/ranks.md",
    "study": "what accuracy costs in time, by `drapery study`; writes dev/measurements/studies.md",
    "symptoms": "the remedies of guide/troubleshooting.md, before and after; writes its table",
}


def main():
    parser = argparse.ArgumentParser(prog="measure", description=sys.modules["measure"].__doc__)
    parser.add_argument("name", nargs="?", help=f"{', '.join(NAMES)}; all are listed where it is left out")
    parser.add_argument("--rows", default="", help="names of some rows or tables with commas between; all if left out")
    parser.add_argument("--list", action="store_true", help="say which rows there are, and do nothing")
    parser.add_argument("--print", action="store_true", help="print the rows; pages and pictures stay as they are")
    parser.add_argument("--repeat", type=int, default=1, help="runs of each kind, of which the fastest counts")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--frames", type=int, default=0, help="at most this many frames of a run after its first, to try a row")
    parser.add_argument("--against", default="336fa90", help="the earlier commit, which is built once")
    options = parser.parse_args(namespace=runs.OPTIONS)
    if not options.name:
        print("\n".join(f"{name:<14} {what}" for name, what in NAMES.items()))
        return
    if options.name not in NAMES:
        parser.error(f"no measurement is called {options.name}; they are {', '.join(NAMES)}")
    tables = importlib.import_module(f"measure.{options.name}").TABLES
    wanted = options.rows.split(",") if options.rows else [table.mark for table in tables]
    rows = [(table, name) for table in tables for name in table.rows if {name, table.mark} & set(wanted)]
    known = {word for table in tables for word in (table.mark, *table.rows)}
    if unknown := [word for word in wanted if word not in known]:
        parser.error(f"no row is called {unknown[0]}; --list says which there are")
    if options.list:
        print("\n".join(f"{table.mark:<12} {name:<16} {table.rows[name][0]}" for table, name in rows))
        return
    failed = []
    for table, name in rows:
        print(f"{name}: {table.rows[name][0]}", file=sys.stderr, flush=True)
        try:
            table.measure(name)
        except (runs.Failed, subprocess.CalledProcessError) as trouble:
            print(f"{name}: {trouble}", file=sys.stderr, flush=True)
            failed.append(name)
    if failed:
        sys.exit(f"not measured: {', '.join(failed)}")


main()
