"""Runs the built commands once for each scene that the tests look at.

`DRAPERY` and `DRAPERY_ASSETS` name the programs; `make test` sets them. Without them the release build in
`target/` is taken.
"""

import os
import subprocess
from pathlib import Path

import pytest

from howto import Run, frames_of
from judges import ROOT, SHARED
from machines import Machines, NoMachines


@pytest.fixture
def report_figure(record_property):
    """Keeps a sentence with figures for the end of the test session, where it is seen also when all is well."""
    return lambda sentence: record_property("figure", sentence)


def pytest_terminal_summary(terminalreporter):
    reports = [report for reports in terminalreporter.stats.values() for report in reports]
    lines = []
    # They travel with the report of a test from the process that ran it.
    for report in reports:
        if getattr(report, "when", None) != "call":
            continue
        name = report.nodeid.split("::")[-1]
        lines += [f"FIGURE {name}: {value}" for key, value in report.user_properties if key == "figure"]
    if lines:
        terminalreporter.section("figures")
        for line in lines:
            terminalreporter.line(line)


@pytest.fixture
def make_machines(tmp_path):
    """Makes two machines that are connected by a cable: `make_machines(delay=50e-6, rate=1e9)`; skips where nobody can."""
    made = []

    def make(**cable):
        folder = tmp_path / f"machines_{len(made)}"
        folder.mkdir()
        try:
            made.append(Machines(folder, **cable))
        except NoMachines as why:
            pytest.skip(str(why))
        return made[-1]

    yield make
    for two in made:
        two.close()


def program(variable, name):
    path = os.environ.get(variable, str(ROOT / "target" / "release" / name))
    if not os.path.isfile(path):
        pytest.exit(f"{path} does not exist; build it with `make build`", returncode=2)
    return path


@pytest.fixture(scope="session")
def drapery_command():
    """Command line of a run, as a list: `drapery_command(scene, frames, out, threads, resolution="20")`."""
    drapery = program("DRAPERY", "drapery")

    def command(scene, frames, out, threads=2, **parameters):
        line = [drapery, "run", str(ROOT / scene), "--frames", frames, "--out", str(out), "--threads", str(threads)]
        for name, value in parameters.items():
            line += ["--set", f"{name}={value}"]
        return line

    return command


@pytest.fixture(scope="session")
def run_scene(drapery_command, tmp_path_factory):
    """Runs a scene and returns its output folder; the same run asked for again is not repeated.

    Runs in the folder `DRAPERY_LONG_RUNS`, if that is set, outlive the tests: a run that was stopped goes on.
    """
    finished = {}
    kept = os.environ.get("DRAPERY_LONG_RUNS")

    def folder(scene, frames, parameters):
        if not kept:
            return tmp_path_factory.mktemp("run")
        settings = [f"{name}={Path(str(value)).name}" for name, value in sorted(parameters.items())]
        return Path(kept) / "_".join([Path(scene).stem, frames, *settings])

    def run(scene, frames, threads=2, **parameters):
        key = (scene, frames, threads, tuple(sorted(parameters.items())))
        if key not in finished:
            out = folder(scene, frames, parameters)
            command = drapery_command(scene, frames, out, threads, **parameters)
            done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
            assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-4000:]}{done.stderr[-4000:]}"
            finished[key] = out
        return finished[key]

    return run


def make_assets(folder, *arguments):
    """Runs `drapery-assets` into a folder, and returns the folder."""
    command = [program("DRAPERY_ASSETS", "drapery-assets"), *arguments, "--out", str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="session")
def make_mannequin(tmp_path_factory):
    """Generates the character with garments of a fineness, `light` or `full`, and returns the folder."""

    def make(garments):
        return make_assets(tmp_path_factory.mktemp("mannequin"), "mannequin", "--garments", garments)

    return make


@pytest.fixture(scope="session")
def mannequin(make_mannequin):
    """Folder with the generated character and its light garments."""
    return make_mannequin("light")


@pytest.fixture(scope="session")
def dressed(run_scene, mannequin):
    """Output folder of the first half second of the dressed mannequin."""
    return run_scene("sample_assets/scenes/dressed_mannequin.toml", "1001-1013", assets=mannequin)


@pytest.fixture(scope="session")
def howto_assets(tmp_path_factory):
    """Folder with the mannequin and the coat, as the how-to pages make them."""
    folder = make_assets(tmp_path_factory.mktemp("howto_assets"), "mannequin", "--resolution", "0.5", "--frames", "1001-1025")
    return make_assets(folder, "coat")


@pytest.fixture(scope="session")
def run_howto(run_scene, howto_assets):
    """Runs a scene over its own frames or others, and reads it: `run_howto(scene, "0-4", **{"output.samples": 3})`."""

    def run(scene, frames=None, **settings):
        if "$assets" in (ROOT / scene).read_text():
            settings["assets"] = howto_assets
        return Run(run_scene(str(scene), frames or "-".join(map(str, frames_of(scene))), **settings))

    return run


@pytest.fixture(scope="session")
def shared_data():
    """Folder with data made by others; tests that need it are skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("no shared data")
    return SHARED
