"""Studies, verification, materials; the package is typed; the page of the tour is run."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import drapery
from table_scene import SHEET, scene

PAGES = Path(__file__).parents[3] / "docs"


def test_a_study_says_what_accuracy_costs_and_goes_on(tmp_path: Path) -> None:
    made = scene(1006)
    study = drapery.study(made, tmp_path, vary={"cfl": [4, 1]}, max_wall=40, copies=1, repeats=1)
    assert [row.label for row in study.rows][:3] == ["as the scene", "cfl 4", "cfl 1"]
    fine = study.rows[2]
    assert fine.settings == {"solver.cfl": "1"} and fine.seconds > 0 and fine.error is not None
    # The error over the window is the root of the mean of the squares.
    in_window = fine.errors[: study.window]
    assert fine.error == pytest.approx(np.sqrt(np.mean(in_window**2)))
    assert fine.errors.shape == study.times.shape == study.frames.shape and study.times[0] == 0
    assert fine.steps > study.rows[1].steps and fine.error < (study.rows[1].error or 0)
    assert "cfl 4" in repr(study) and "cfl 4" in study._repr_html_() and (study.folder / "report.html").exists()
    again = drapery.study(scene(1006), tmp_path, vary={"cfl": [4, 1]}, max_wall=40, copies=1, repeats=1)
    assert len(again.record["samples"]) >= len(study.record["samples"])
    assert drapery.read_study(tmp_path / "study.json").rows[2].error == again.rows[2].error
    with pytest.raises(drapery.OutputError, match="something else"):
        drapery.study(scene(1005), tmp_path, vary={"cfl": [4, 1]})
    with pytest.raises(drapery.InputError):
        drapery.read_study(tmp_path / "none.json")
    for wrong in ({"max_wall": -1}, {"max_wall": float("nan")}, {"repeats": 0}):
        with pytest.raises(drapery.UsageError):
            drapery.study(made, tmp_path / "other", **wrong)  # type: ignore[arg-type]


def test_caches_are_verified(tmp_path: Path) -> None:
    drapery.Scene.parse(SHEET).shot().run(tmp_path)
    found = drapery.verify(tmp_path / "sheet.abc", tmp_path / "sheet.usd")
    assert found.ok and "every rule is kept" in repr(found) and any("samples" in fact for fact in found.facts)
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


def test_materials_are_those_of_the_command(tmp_path: Path) -> None:
    materials = drapery.materials()
    denim = materials["denim_11oz"]
    assert denim.path is None and 0.3 < denim.density < 0.5 and denim.provenance
    listed = subprocess.run([sys.executable, "-m", "drapery", "materials"], capture_output=True, text=True).stdout
    assert [line.split(":")[0] for line in listed.splitlines() if not line.startswith(" ")] == list(materials)
    with pytest.raises(drapery.InputError):
        drapery.materials([tmp_path / "none"])


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
    package, tests = Path(drapery.__file__).parent, Path(__file__).parent
    for target in (sample, package, tests):
        words = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), str(target)]
        done = subprocess.run(words, capture_output=True, text=True, cwd=tests)
        assert done.returncode == 0, done.stdout
    sample.write_text(sample.read_text().replace('"resolution": 8', '8: "resolution"'))
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", str(sample)], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode != 0, "types are checked"


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


@pytest.mark.parametrize("page", ["tour/05_python.md", "python.md"])
def test_the_code_of_the_pages_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    text = (PAGES / page).read_text()
    blocks = re.findall(r"```python\n(.*?)```\n(?:\n```text expect\n(.*?)```)?", text, re.DOTALL)
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
