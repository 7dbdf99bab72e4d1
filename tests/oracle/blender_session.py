"""Sessions of Blender with the add-on: as a Python module, Debian's without a window, and with one that is drawn into a frame buffer."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from judges import HERE, ROOT

PACKAGE = ROOT / "plugins" / "blender" / "package.py"


def package(*arguments):
    """Makes the zip of the add-on; returns the process, which has ended, and the path of the zip."""
    done = subprocess.run([sys.executable, str(PACKAGE), *map(str, arguments)], capture_output=True, text=True)
    return done, Path(done.stdout.strip())


def exporter_in(folder):
    """Writes a stand-in for a Blender with Alembic: it calls the module as a Blender is called."""
    path = folder / "blender_with_alembic"
    path.write_text('#!/bin/sh\n# --background --disable-autoexec FILE --python-exit-code 1 --python SCRIPT -- JOB\n'
                    f'exec "{sys.executable}" "$7" -- "$9" "$3"\n')  # fmt: skip
    path.chmod(0o755)
    return path


def needs_blender(kind):
    """Skips a test of Debian's Blender where there is none."""
    if kind == "debian" and shutil.which("blender") is None:
        pytest.skip("no blender; `make setup` installs it on Debian")


def blender_does(kind, script, folder, file, *words):
    """Runs a script with these words in Blender, "module" or "debian"; what it printed, and its answer in a file of the folder."""
    (folder / "scripts" / "addons").mkdir(parents=True)
    start = [sys.executable] if kind == "module" else ["blender", "--background", "--factory-startup", "--python"]
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(folder / "user"), "BLENDER_USER_CONFIG": str(folder / "config"),
                                "BLENDER_USER_SCRIPTS": str(folder / "scripts")}  # fmt: skip
    line = list(map(str, [*start, HERE / script, "--", *words]))
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300)
    said = done.stdout + done.stderr
    assert (folder / file).exists(), said[-4000:]
    answer = json.loads((folder / file).read_text())
    assert "failed" not in answer, answer["failed"] + said[-4000:]
    return said, answer


def session(folder, drapery):
    """Presses every button in an empty folder; returns what Blender printed. The folder has answer.json and the pictures then."""
    (folder / "scripts" / "addons").mkdir(parents=True)
    _, archive = package("--without-solver", folder)
    exporter = exporter_in(folder)
    command = ["xvfb-run", "-a", "-s", "-screen 0 900x3000x24", "blender", "--factory-startup", "--window-geometry", "0", "0", "900",
               "3000", "--python", str(HERE / "blender_window.py"), "--", str(folder), str(archive),
               drapery, str(exporter)]  # fmt: skip
    environment = os.environ | {"BLENDER_USER_CONFIG": str(folder / "config"), "BLENDER_USER_SCRIPTS": str(folder / "scripts"),
                                "LIBGL_ALWAYS_SOFTWARE": "1", "TMPDIR": str(folder)}  # fmt: skip
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=900)
    return done.stdout + done.stderr
