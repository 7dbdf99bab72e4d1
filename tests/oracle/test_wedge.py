"""Wedges: the runs of `drapery wedge` and the page that compares runs, judged from their caches."""

import csv
import os
import re
import signal
import subprocess
import time

import numpy as np
import pytest

from farm import DRAPERY
from howto import HOWTO, Run, said
from judges import ROOT

SCENE = f"{HOWTO}/fabric.toml"
SMALL = ("--set", "resolution=8")
STOPPED, FAILED = 75, 1


def wedge(out, *arguments, code=0):
    return said("wedge", SCENE, *SMALL, "--out", out, *arguments, code=code)


def table(out):
    """Rows of comparison.csv by the names of the runs."""
    with (out / "comparison.csv").open() as file:
        return {row["run"]: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module", autouse=True)
def in_the_project():
    before = os.getcwd()
    os.chdir(ROOT)
    yield
    os.chdir(before)


@pytest.fixture(scope="module")
def fabrics(tmp_path_factory):
    out = tmp_path_factory.mktemp("wedge")
    text = wedge(out, "--vary", "fabric=silk_light,denim_11oz", "--vary", "body.ball.friction=0.1,0.6", "--frames", "0-6", "--jobs", "2")
    return out, text


def test_every_combination_is_a_run_like_any_other(fabrics, tmp_path):
    """The positions are those of `drapery run` with the same values."""
    out, text = fabrics
    names = [f"fabric={fabric},friction={friction}" for fabric in ("silk_light", "denim_11oz") for friction in ("0.1", "0.6")]
    assert list(table(out)) == names and all(f"run {number} of 4: {name}" in text for number, name in enumerate(names, 1))
    assert {path.name for path in out.iterdir()} == {*names, "logs", "comparison.html", "comparison.csv"}
    said("run", SCENE, *SMALL, "--set", "fabric=denim_11oz", "--set", "body.ball.friction=0.6", "--frames", "0-6", "--out", tmp_path / "one")
    one, other = Run(tmp_path / "one"), Run(out / names[3])
    assert np.array_equal(one.positions("square"), other.positions("square"))
    assert (out / names[3] / "report.html").is_file()


def test_the_table_holds_what_the_caches_say(fabrics):
    """Strain and distance from the first run, computed anew from positions."""
    out, _ = fabrics
    rows = table(out)
    for name, row in rows.items():
        assert name == f"fabric={row['fabric']},friction={row['body.ball.friction']}"
    runs = {name: Run(out / name) for name in rows}
    first, last = next(iter(runs.values())), list(runs)[-1]
    apart = np.linalg.norm(runs[last].positions("square") - first.positions("square"), axis=2)
    assert float(rows[last]["distance_rms_m"]) == pytest.approx(np.sqrt((apart**2).mean()), rel=1e-4)
    assert float(rows[last]["distance_max_m"]) == pytest.approx(apart.max(), rel=1e-4)
    assert float(rows[next(iter(rows))]["distance_max_m"]) == 0.0
    for name, run in runs.items():
        strains = max(record["strains"][0]["p99_9"] for record in run.records.values())
        assert float(rows[name]["strain_p99_9"]) == strains
        assert (rows[name]["state"], rows[name]["frames_done"]) == ("done", "7")


def test_the_page_shows_every_run_and_the_settings_that_differ(fabrics):
    out, _ = fabrics
    page = (out / "comparison.html").read_text()
    # 12 pictures for 4 runs: 3 frames of each.
    assert page.count("<img ") == 12 and page.count("<h3>frame ") == 3
    assert "<td>body.ball.friction</td><td>0.1</td><td>0.6</td><td>0.1</td><td>0.6</td>" in page
    assert "<td>garment.square.material</td><td>silk_light</td>" in page and "body.ball.position" not in page
    links = re.findall(r'<a href="([^"]+)">', page)
    assert len(links) == 4 and all((out / link).is_file() for link in links)


def test_two_runs_side_by_side(fabrics, tmp_path):
    out, _ = fabrics
    folders = [out / "fabric=silk_light,friction=0.1", out / "fabric=denim_11oz,friction=0.1"]
    text = said("report", *folders, "--out", tmp_path / "two.html")
    assert f"wrote {tmp_path / 'two.html'}" in text and (tmp_path / "two.html").read_text().count("<img ") == 12
    assert str(tmp_path) in said("report", folders[0], tmp_path, code=66)


def test_the_folder_of_a_wedge_is_all_of_its_runs_or_says_which_it_has(fabrics, tmp_path):
    """`report` compares all of them; commands that look at one run name one."""
    out, _ = fabrics
    text = said("report", out, "--out", tmp_path / "all.html")
    assert all(name in text for name in table(out)) and (tmp_path / "all.html").is_file()
    first = f"it holds the folders of 4 runs; give one of them, for example {out / 'fabric=denim_11oz,friction=0.1'}"
    for words in (("view", out, "--page", tmp_path / "page.html"), ("diff", out, out), ("stop", out)):
        assert first in said(*words, code=66), words
    assert f"{out}/*.abc" in said("verify", out, code=65)


def test_a_value_that_no_run_can_have_is_named_before_anything_runs(tmp_path):
    text = wedge(tmp_path / "out", "--vary", "fabric=silk_light,no_such_fabric", code=78)
    assert "run fabric=no_such_fabric" in text and "no_such_fabric" in text and not (tmp_path / "out").exists()
    text = wedge(tmp_path / "out", "--vary", "fabric=silk_light,denim_11oz", "--frames", "3-6", code=2)
    assert "run fabric=silk_light" in text and "a run starts at frame 0" in text and not (tmp_path / "out").exists()


def test_values_with_brackets_have_plain_names(tmp_path):
    wedge(tmp_path, "--vary", "gravity.acceleration=[0,-9.81,0],[0,-1.6,0]", "--frames", "0-1")
    assert list(table(tmp_path)) == ["acceleration=0,-9.81,0", "acceleration=0,-1.6,0"]


def test_a_wedge_of_a_thousand_is_refused(tmp_path):
    values = ",".join(str(1e-3 * step) for step in range(1, 1001))
    text = wedge(tmp_path / "out", "--vary", f"body.ball.friction={values}", code=2)
    assert "this wedge has 1000 runs, more than 100" in text and "--most 1000" in text and not (tmp_path / "out").exists()


def test_a_run_that_fails_does_not_stop_the_others(tmp_path):
    """A ball around the cloth: the run is refused, and the others are done."""
    text = wedge(tmp_path, "--vary", "body.ball.shape.sphere.radius=2,0.2", "--frames", "0-1", code=FAILED)
    rows = table(tmp_path)
    assert [row["state"] for row in rows.values()] == ["not run", "done"]
    assert "radius=2 failed" in text
    assert "inside" in (tmp_path / "logs" / f"{next(iter(rows))}.txt").read_text()


def test_what_another_scene_has_left_in_a_folder_is_no_result(tmp_path):
    common = ["--frames", "0-1"]
    wedge(tmp_path, "--vary", "body.ball.friction=0.1", "--set", "resolution=6", *common)
    text = wedge(tmp_path, "--vary", "body.ball.friction=0.1,0.2", "--set", "resolution=5", *common, code=FAILED)
    refused, done = table(tmp_path).values()
    assert (refused["state"], done["state"]) == ("refused: see its log", "done") and "friction=0.1 failed" in text
    assert not float(refused["strain_p99_9"] or 0) and float(done["strain_p99_9"]) > 0


def test_a_wedge_that_was_stopped_goes_on_where_it_was(tmp_path):
    arguments = ["--vary", "resolution=40,6", "--frames", "0-16", "--out", tmp_path / "out"]
    command = [DRAPERY, "wedge", SCENE, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    record = tmp_path / "out" / "resolution=40" / "run.jsonl"
    deadline = time.monotonic() + 120
    while not (record.is_file() and record.read_text().count('"frame"') > 3) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=120)
    assert process.returncode == STOPPED and "continue with: drapery wedge" in printed, printed
    assert [row["state"] for row in table(tmp_path / "out").values()] == ["stopped", "not run"]
    # Jobs of a scheduler do the rest, and the wedge runs nothing again.
    listed = said("wedge", *command[2:], "--list").splitlines()
    assert len(listed) == 2 and not any("--threads" in line for line in listed), "the host of a job has its own cores"
    assert all("--threads 3" in line for line in said("wedge", *command[2:], "--list", "--threads", "3").splitlines())
    shown = said("status", tmp_path / "out")
    assert "resolution=40" in shown and "stopped" in shown, "the runs of the wedge that have begun"
    for line in listed:
        subprocess.run(["bash", "-c", line.replace("drapery", str(DRAPERY), 1)], check=True, stdout=subprocess.DEVNULL)
    assert [row["state"] for row in table(tmp_path / "out").values()] == ["stopped", "not run"]
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").glob("*/square.*")}
    said("wedge", *command[2:])
    assert [row["state"] for row in table(tmp_path / "out").values()] == ["done", "done"]
    assert len(times) == 4 and all(path.stat().st_mtime_ns == time for path, time in times.items())
    whole = tmp_path / "whole"
    said("run", SCENE, "--set", "resolution=40", "--frames", "0-16", "--out", whole)
    assert np.array_equal(Run(whole).positions("square"), Run(tmp_path / "out" / "resolution=40").positions("square"))
