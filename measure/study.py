"""Output of `drapery study` for the spinning ball and the dressed mannequin, and pictures of its pages.

The machine should do nothing else meanwhile. Pictures need Chromium; without it they stay as they are.
"""

import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

from measure.page import Block
from measure.runs import OPTIONS, ROOT, TODAY, Failed, assets
from measure.scenes import SAMPLES

PAGE = "dev/measurements/studies.md"
MAX_WALL = "120s"
# Size of a picture's page, and width of the picture, in pixels.
WINDOW, WIDTH = (1240, 2300), 1000


def wait_for_quiet():
    """Waits until what ran before shows no more in the load of the machine, for a few minutes at most."""
    patience = time.monotonic() + 300.0
    while os.getloadavg()[0] > 0.5 and time.monotonic() < patience and not OPTIONS.print:
        time.sleep(5.0)


def study(name, scene, budget, settings=lambda: []):
    def measure():
        wait_for_quiet()
        with tempfile.TemporaryDirectory() as folder:
            command = [TODAY, "study", SAMPLES / scene, "--out", f"{folder}/out", "--max-wall", MAX_WALL, "--budget", budget, *settings()]
            command += ["--frames", f"0-{OPTIONS.frames}"] if OPTIONS.frames else []
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                raise Failed(f"{' '.join(map(str, command))}: {done.stderr}")
            if not OPTIONS.print:
                photograph(f"{folder}/out/report.html", ROOT / "docs" / "pictures" / f"study_{name}.png", Path(folder))
        lines = done.stdout.splitlines()
        begin = next(number for number, line in enumerate(lines) if line.startswith("study "))
        return ["```", *(line for line in lines[begin:] if not line.startswith("wrote ")), "```"]

    return Block(PAGE, name, f"{scene}, {budget}, --max-wall {MAX_WALL}", measure)


def photograph(page, picture, folder):
    """Writes the upper part of a page as a picture, if there is a browser."""
    from PIL import Image

    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        print("no Chromium: the picture stays as it is")
        return
    shot = folder / "page.png"
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--screenshot={shot}"]
    subprocess.run([browser, *options, f"--window-size={WINDOW[0]},{WINDOW[1]}", f"file://{page}"], check=True, capture_output=True)
    with Image.open(shot) as image:
        small = image.convert("RGB").resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    small.save(picture, optimize=True)


TABLES = [
    study("ball", "spinning_ball.toml", "1s/frame"),
    study("woman", "dressed_mannequin.toml", "20s/frame", lambda: [f"--set=assets={assets('mannequin', '--garments', 'light')}"]),
]
