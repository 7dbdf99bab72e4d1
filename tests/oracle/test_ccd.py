"""Continuous collision detection beside the published conservative tests, on the reference queries.

Ours answers through the example `ccd_queries` of the core crate, `ipctk` in this process; the first also says how
many queries a second it answers in one thread; the speed of the others includes a call from Python each, about a
microsecond. `pytest -s` shows the table. Tight inclusion needs about two minutes.
"""

import os
import subprocess
import time
from fractions import Fraction

import ipctk
import numpy as np
import pytest

from judges import ROOT

KINDS = {"edge-edge": "edge_edge", "vertex-face": "point_triangle"}


def read_queries(folder):
    """Positions (query, time, point, axis), truth and time of first contact (nan: none) of all files of a folder."""
    positions, truths, times = [], [], []
    for path in sorted(folder.glob("data_*_?.csv")):
        rows = [[int(n) for n in line.split(",")] for line in path.read_text().split()]
        values = [[float(Fraction(row[2 * i], row[2 * i + 1])) for i in range(3)] for row in rows]
        positions.append(np.array(values).reshape(-1, 2, 4, 3))
        for line in path.with_suffix(".toi.csv").read_text().split()[1:]:
            _, truth, toi, _ = line.split(",")
            truths.append(truth == "1")
            times.append(float(toi) if toi else np.nan)
    return np.concatenate(positions), np.array(truths), np.array(times)


@pytest.fixture(scope="module")
def queries(shared_data):
    """Queries of every scene and kind: {(scene, kind): (positions, truths, times)}."""
    folders = sorted(path for path in (shared_data / "ccd_queries").iterdir() if path.is_dir())
    return {(folder.name, kind): read_queries(folder / kind) for folder in folders for kind in KINDS}


@pytest.fixture(scope="module")
def program():
    target = os.environ.get("CARGO_TARGET_DIR", str(ROOT / "target"))
    command = ["cargo", "build", "--release", "--quiet", "-p", "drapery-core", "--example", "ccd_queries"]
    subprocess.run(command, cwd=ROOT, check=True)
    return os.path.join(target, "release", "examples", "ccd_queries")


def ours(program, kind, positions, path):
    """Hits, times (nan: none) and queries a second of the example."""
    path.write_bytes(positions.astype("<f8").tobytes())
    done = subprocess.run([program, KINDS[kind], str(path), "0"], check=True, capture_output=True, text=True)
    rate, *lines = done.stdout.split()
    times = np.array([float(line[2:]) if line[2:] else np.nan for line in lines])
    return ~np.isnan(times), times, float(rate)


def theirs(test, kind, positions):
    """Hits, times (nan: none) and queries a second of one of the tests of `ipctk`."""
    ask = test.edge_edge_ccd if kind == "edge-edge" else test.point_triangle_ccd
    arguments = [[*start, *end] for start, end in positions]
    begin = time.perf_counter()
    answers = [ask(*points) for points in arguments]
    seconds = time.perf_counter() - begin
    hits = np.array([hit for hit, _ in answers])
    return hits, np.where(hits, [t for _, t in answers], np.nan), len(answers) / seconds


@pytest.mark.full
def test_as_conservative_as_tight_inclusion_with_at_most_twice_its_false_positives(
    queries, program, tmp_path, report_figure
):
    tests = {"tight inclusion": ipctk.TightInclusionCCD(), "additive": ipctk.AdditiveCCD()}
    sums = {name: np.zeros(3) for name in ["ours", *tests]}
    for (scene, kind), (positions, truths, times) in queries.items():
        found = {"ours": ours(program, kind, positions, tmp_path / "queries.f64")}
        found |= {name: theirs(test, kind, positions) for name, test in tests.items()}
        line = f"{scene}/{kind}: {len(truths)} queries, {truths.sum()} hits;"
        wrong = {}
        for name, (hits, _, rate) in found.items():
            wrong[name] = int((hits & ~truths).sum())
            sums[name] += [(~hits & truths).sum(), wrong[name], len(truths) / rate]
            line += f" {name}: {wrong[name]} false, {rate:,.0f} a second;"
        print(line)
        hits, at, _ = found["ours"]
        assert hits[truths].all(), f"{scene}/{kind}: missed {np.flatnonzero(truths & ~hits)}"
        assert (at[truths] <= times[truths]).all(), f"{scene}/{kind}: later than the truth"
        assert wrong["ours"] <= 2 * wrong["tight inclusion"], f"{scene}/{kind}: {wrong}"
    total = sum(len(truths) for _, truths, _ in queries.values())
    for name, (missed, false, seconds) in sums.items():
        report_figure(f"{name}: {missed:.0f} missed, {false:.0f} false positives of {total} queries, "
                      f"{total / seconds:,.0f} queries a second")
