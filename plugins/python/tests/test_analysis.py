"""Studies, verification, materials; the package is typed; the page of the tour is run."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import drapery
from table_scene import SHEET, scene

PAGES = Path(__file__).parents[3] / "docs"


def test_a_study_says_what_accuracy_costs_and_goes_on(tmp_path: Path) -> None:
    made = scene(1006)
    study = drapery.study(made, tmp_path, vary={"cfl": [4, 1]}, max_wall=40, copies=1, repeats=1)
    # The scene has cfl 4 already.
    assert [row.label for row in study.rows][:2] == ["as the scene", "cfl 1"]
    coarse, fine = study.rows[:2]
    assert fine.settings == {"solver.cfl": "1"} and fine.seconds > 0 and fine.error is not None
    # The error over the window is the root of the mean of the squares.
    in_window = fine.errors[: study.window]
    assert fine.error == pytest.approx(np.sqrt(np.mean(in_window**2)))
    assert fine.errors.shape == study.times.shape == study.frames.shape and study.times[0] == 1 / 24
    assert fine.steps > coarse.steps and coarse.error is not None and fine.error < coarse.error
    assert "cfl 1" in repr(study) and "cfl 1" in study._repr_html_() and (study.folder / "report.html").exists()
    again = drapery.study(scene(1006), tmp_path, vary={"cfl": [4, 1]}, max_wall=40, copies=1, repeats=1)
    assert len(again.record["samples"]) >= len(study.record["samples"])
    assert drapery.read_study(tmp_path / "study.json").rows[1].error == again.rows[1].error
    with pytest.raises(drapery.OutputError, match="a different study"):
        drapery.study(scene(1005), tmp_path, vary={"cfl": [4, 1]})
    with pytest.raises(drapery.InputError):
        drapery.read_study(tmp_path / "none.json")
    for seconds, repeats in ((-1.0, 1), (float("nan"), 1), (1.0, 0)):
        with pytest.raises(drapery.UsageError):
            drapery.study(made, tmp_path / "other", max_wall=seconds, repeats=repeats)


def test_ctrl_c_ends_a_study_which_goes_on(tmp_path: Path) -> None:
    made = scene(1020)
    made.set("garment.cloth.panel.resolution", 40)
    earlier = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 1.5)
        begun = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            drapery.study(made, tmp_path, max_wall=60)
        assert time.monotonic() - begun < 10
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, earlier)
    study = drapery.study(made, tmp_path, vary=None, max_wall=4, frames=(1001, 1002), overwrite=True)
    assert study.rows


def test_caches_are_verified(tmp_path: Path) -> None:
    drapery.Scene.parse(SHEET).shot().run(tmp_path)
    both = drapery.verify(tmp_path / "sheet.abc", tmp_path / "sheet.usd")
    assert not both.ok and "sheet.usd" in repr(both), "the same cloth twice passes through itself"
    found = drapery.verify(tmp_path / "sheet.abc")
    assert found.ok and drapery.verify(tmp_path / "sheet.usd").ok and "all rules are met" in repr(found) and any("samples" in fact for fact in found.facts)
    assert drapery.verify(tmp_path / "sheet.h5", record=tmp_path).ok
    data = bytearray((tmp_path / "sheet.h5").read_bytes())
    positions = drapery.open_cache(tmp_path / "sheet.h5").mesh.positions(6).astype(np.float32).tobytes()
    data[data.index(positions) + 5] ^= 1
    (tmp_path / "sheet.h5").write_bytes(data)
    broken = drapery.verify(tmp_path / "sheet.h5", record=tmp_path)
    assert not broken.ok and "frame 6" in broken.failures[0] and "broken" in repr(broken)
    with pytest.raises(drapery.InputError):
        drapery.verify(tmp_path / "none.abc")
    with pytest.raises(drapery.UsageError):
        drapery.verify()


def test_materials_are_those_of_the_command() -> None:
    materials = drapery.materials()
    denim = materials["denim_11oz"]
    assert denim.path is None and 0.3 < denim.density < 0.5 and denim.provenance
    listed = subprocess.run([sys.executable, "-m", "drapery", "materials"], capture_output=True, text=True).stdout
    assert [line.split(":")[0] for line in listed.splitlines() if not line.startswith(" ")] == list(materials)


def test_the_package_is_typed(tmp_path: Path) -> None:
    sample = tmp_path / "sample.py"
    sample.write_text(
        "import drapery\nfrom pathlib import Path\n\n\n"
        "def lowest(path: Path) -> float:\n"
        '    simulation = drapery.Scene.load(path, {"resolution": 8}).simulate()\n'
        "    frame: drapery.Frame = simulation.advance()\n"
        "    print(frame.counts, simulation.velocities().shape)\n"
        "    return float(simulation.positions()[:, 1].min())\n"
    )
    tests = Path(__file__).parent

    def check(folder: Path, *what: str) -> "subprocess.CompletedProcess[str]":
        words = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "mypy"), *what]
        return subprocess.run(words, capture_output=True, text=True, cwd=folder)

    for done in (check(tests.parent / "python", "-p", "drapery"), check(tests, "."), check(tmp_path, str(sample))):
        assert done.returncode == 0, done.stdout
    sample.write_text(sample.read_text().replace('"resolution": 8', '8: "resolution"'))
    assert check(tmp_path, str(sample)).returncode != 0, "types are checked"


def test_everything_public_is_documented_with_units() -> None:
    for name in drapery.__all__:
        thing = getattr(drapery, name)
        if not isinstance(thing, type) or issubclass(thing, tuple):
            continue
        assert thing.__doc__, name
        for part, value in vars(thing).items():
            documented = callable(value) or isinstance(value, property)
            if documented and not part.startswith("_"):
                assert value.__doc__, f"{name}.{part}"
    assert "[m/s]" in (drapery.Simulation.velocities.__doc__ or "")


@pytest.mark.parametrize("page", ["howto/from_python.md", "reference/python.md"])
def test_the_code_of_the_pages_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = (PAGES / page).read_text()
    blocks = re.findall(r"```python\n(.*?)```\n(?:\n```text expect\n(.*?)\n```)?", text, re.DOTALL)
    assert blocks
    program, expected = tmp_path / "page.py", ""
    program.write_text("\n".join(code for code, _ in blocks))
    expected = "\n".join(shown for _, shown in blocks if shown)
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    printed = iter(done.stdout.splitlines())
    for line in expected.splitlines():
        pattern = ".*".join(map(re.escape, line.split("…")))
        assert any(re.fullmatch(pattern, other) for other in printed), f"{line}\nis not printed, in this order:\n{done.stdout}"
    for picture in re.findall(r'savefig\("(.*?)"', text):
        assert (tmp_path / picture).stat().st_size > 5000
