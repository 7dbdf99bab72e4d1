"""Runs: the same bytes as the command, Ctrl-C, a kill, a full disk, messages."""

import logging
import os
import resource
import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest

import drapery
from table_scene import SHEET, scene

LONG = SHEET.replace('"1-6"', '"1-100000"').replace("resolution = 4", "resolution = 20").replace(', "h5", "usd"', "")
"""A run that nobody waits for."""

RUN = """
import drapery, resource, signal, sys
# A shell starts what it leaves in the background with SIGINT ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
path, out, limit = sys.argv[1:]
if int(limit):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
try:
    drapery.Scene.load(path).shot().run(out, lambda progress: print(progress.frame, flush=True))
except KeyboardInterrupt:
    print("stopped", flush=True)
except drapery.DraperyError as error:
    print(type(error).__name__, error.code, error, flush=True)
"""


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    path = tmp_path / "sheet.toml"
    path.write_text(SHEET)
    return path


def start(path: Path, out: Path, limit: int = 0) -> "subprocess.Popen[str]":
    """Runs a scene in another process."""
    words = [sys.executable, "-c", RUN, str(path), str(out), str(limit)]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


def caches(folder: Path) -> dict[str, bytes]:
    """Bytes of the caches that a run has delivered, without stale ones. HDF5 files are left out: the times in them differ."""
    kept = [path.relative_to(folder) for path in folder.rglob("*") if path.suffix in (".abc", ".usd", ".usda", ".usdc")]
    return {str(path): (folder / path).read_bytes() for path in kept if path.parts[0] != "stale"}


def test_a_run_has_the_bytes_of_the_command(tmp_path: Path, sheet: Path) -> None:
    drapery.Scene.load(sheet).shot().run(tmp_path / "ours")
    # The command of the wheel as a module and as a script; and the program itself, where the tests know it.
    script = str(Path(sys.executable).with_name("drapery"))
    program = os.environ.get("DRAPERY")
    for number, command in enumerate([[sys.executable, "-m", "drapery"], [script], *([[program]] if program else [])]):
        out = tmp_path / f"theirs_{number}"
        done = subprocess.run([*command, "run", sheet, "--out", out, "--threads", "1"], capture_output=True, text=True)
        assert done.returncode == 0 and "done: frame 6" in done.stdout, done.stderr
        assert len(caches(out)) > 2 and caches(out) == caches(tmp_path / "ours")
        simulation, other = drapery.Scene.load(sheet).simulate(), drapery.Scene.load(sheet).simulate()
        simulation.restore_file(out / "checkpoints" / "frame_00006.h5")
        other.restore_file(tmp_path / "ours" / "checkpoints" / "frame_00006.h5")
        assert simulation.positions().tobytes() == other.positions().tobytes()


def test_the_command_has_its_exit_codes_and_its_own_words(tmp_path: Path, sheet: Path) -> None:
    def command(*words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run([sys.executable, "-m", "drapery", *words], capture_output=True, text=True, cwd=tmp_path)

    assert command("--version").stdout.startswith(f"drapery {drapery.__version__}")
    assert command("run").returncode == 2
    missing = command("check", "missing.toml")
    assert missing.returncode == 66 and "missing.toml" in missing.stderr
    assert command("schema").stdout.rstrip().endswith("}")
    bad = command("run", "sheet.toml", "--set", "gravty=1")
    assert bad.returncode == 78 and "Traceback" not in bad.stderr
    assert "usd" in command("--version").stdout or "usd" in command("run", "--help").stdout


def test_signals_are_those_of_the_command(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(LONG)
    words = [sys.executable, "-m", "drapery", "run", "long.toml", "--out", "out", "--progress", "json"]
    run = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    while '"frame"' not in run.stdout.readline():
        pass
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=60)
    assert run.returncode == 75
    # The line that continues it is one that a shell understands.
    assert "drapery run long.toml --out out" in (tmp_path / "out" / "manifest.json").read_text()


def test_ctrl_c_stops_at_a_checkpoint_and_the_run_goes_on_from_there(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(LONG)
    run = start(tmp_path / "long.toml", tmp_path / "run")
    assert run.stdout is not None and run.stdout.readline().strip() == "1"
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=60)
    assert run.returncode == 0 and out.strip().splitlines()[-1] == "stopped"
    assert list((tmp_path / "run" / "checkpoints").glob("*.h5"))

    def stop(progress: drapery.Progress) -> None:
        raise RuntimeError(progress.frame)

    with pytest.raises(RuntimeError) as caught:
        drapery.Scene.load(tmp_path / "long.toml").shot().run(tmp_path / "run", stop)
    assert caught.value.args[0] > 1


def test_a_run_that_was_killed_goes_on_with_the_bytes_of_one_that_never_was(tmp_path: Path, sheet: Path) -> None:
    run = start(sheet, tmp_path / "killed")
    assert run.stdout is not None
    while run.stdout.readline().strip() != "3":
        pass
    run.kill()
    run.wait()
    drapery.Scene.load(sheet).shot().run(tmp_path / "killed")
    drapery.Scene.load(sheet).shot().run(tmp_path / "whole")
    assert caches(tmp_path / "killed") == caches(tmp_path / "whole")


def test_an_exception_of_progress_stops_at_a_checkpoint(tmp_path: Path) -> None:
    def stop(progress: drapery.Progress) -> None:
        if progress.frame == 1002:
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        scene().shot().run(tmp_path / "run", stop)
    heard: list[drapery.Progress] = []
    scene().shot().run(tmp_path / "run", heard.append)
    assert [progress.frame for progress in heard] == [1003, 1004]


def test_a_full_disk_is_said_and_nothing_is_lost(tmp_path: Path, sheet: Path) -> None:
    # A limit on the size of files stands for a full disk: both refuse a write in its middle.
    run = start(sheet, tmp_path / "run", 12000)
    out, _ = run.communicate(timeout=60)
    last = [line for line in out.splitlines() if "Error" in line]
    assert run.returncode == 0 and last and last[0].startswith("OutputError 74 "), out
    assert str(tmp_path / "run") in last[0]
    report = drapery.Scene.load(sheet).shot().run(tmp_path / "run")
    drapery.Scene.load(sheet).shot().run(tmp_path / "whole")
    assert report.frame == 6 and caches(tmp_path / "run") == caches(tmp_path / "whole")


def test_a_folder_that_cannot_be_written_to_is_said(tmp_path: Path, sheet: Path) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file" / "out", Path("/proc/out")):
        with pytest.raises(drapery.OutputError, match=str(out)) as caught:
            drapery.Scene.load(sheet).shot().run(out)
        assert caught.value.code == 73
    drapery.Scene.load(sheet).shot().run(tmp_path / "run")
    with pytest.raises(drapery.OutputError) as changed:
        drapery.Scene.load(sheet, {"resolution": 5}).shot().run(tmp_path / "run")
    assert changed.value.code == 73
    assert drapery.Scene.load(sheet, {"resolution": 5}).shot().run(tmp_path / "run", overwrite=True).outcome == "done"


def test_messages_go_to_logging(tmp_path: Path, caplog: pytest.LogCaptureFixture, sheet: Path) -> None:
    caplog.set_level(logging.INFO, logger="drapery")
    drapery.Scene.load(sheet).shot().run(tmp_path / "run")
    assert any("frame 6" in record.getMessage() for record in caplog.records)
    caplog.clear()
    without = SHEET.replace("[gravity]\n", "")
    drapery.Scene.parse(without).validate()
    assert any("no_gravity" in record.getMessage() and record.levelno == logging.WARNING for record in caplog.records)


def test_nothing_is_printed(tmp_path: Path, sheet: Path) -> None:
    words = [sys.executable, "-c", "import drapery, sys; drapery.Scene.load(sys.argv[1]).shot().run(sys.argv[2])"]
    done = subprocess.run([*words, str(sheet), str(tmp_path / "run")], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY


def test_frames_and_reports_print_without_their_counts(tmp_path: Path) -> None:
    made = drapery.Scene.parse(SHEET)
    frame, report = made.simulate().advance(), made.shot().run(tmp_path)
    assert len(frame.counts) > 5 and "counts" not in repr(frame) and f"steps={frame.steps}" in repr(frame)
    assert len(report.counts) > 5 and "counts" not in repr(report) and "outcome='done'" in repr(report)


def test_the_wheel_says_who_made_it_and_under_which_licence() -> None:
    said = metadata.metadata("drapery")
    assert said["Author"] == "The Drapery developers" and said["License-Expression"] == "MIT OR Apache-2.0"
    assert "Typing :: Typed" in (said.get_all("Classifier") or [])
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= set(said.get_all("License-File") or [])
