"""Runs of the pictures of the how-to pages, and the pictures that are plots of such runs: seconds, frames and errors, never invented."""

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from datetime import datetime
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np
from PIL import Image, ImageDraw, ImageFont

import blender_session
import browser
import farm
from howto import frames_of
from measure.runs import timed

ROOT = Path(__file__).parent.parent.parent
HOWTO, SAMPLES = ROOT / "sample_assets" / "howto", ROOT / "sample_assets" / "scenes"
# Seconds for which the stopped run waits, as for its next turn on the farm.
QUEUE = 8.0
BLUE, RED, GREY, LIGHT = "#1c5fa8", "#b03030", "#777777", "#e2e2e2"


def command(drapery, scene, out, last, settings=()):
    """A run of a scene from its first frame, which goes on where it was."""
    line = [drapery, "run", str(scene), "--out", str(out), "--frames", f"{frames_of(scene)[0]}-{last}"]
    return line + [word for setting in settings for word in ("--set", setting)]


def run(line):
    """Runs a command; returns its CPU seconds, which other work on the machine hardly changes."""
    done, cpu, _ = timed(line)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, line))}: {done.stderr}")
    return cpu


def moments(out):
    """Returns, for each attempt of a run, its beginning and the moments at which frames were done, in seconds since the first beginning."""
    attempts = []
    for log in sorted((out / "logs").glob("*.jsonl")):
        entries = [json.loads(line) for line in log.read_text().splitlines()]
        when = [(datetime.fromisoformat(entry["timestamp"]).timestamp(), entry["fields"]) for entry in entries]
        frames = [(moment, fields["frame"]) for moment, fields in when if fields.get("message") == "frame"]
        if frames:
            attempts.append((when[0][0], frames))
    zero = attempts[0][0]
    return [(begin - zero, [(moment - zero, frame) for moment, frame in frames]) for begin, frames in attempts]


def positions(out, garment, frame):
    """Positions of a garment at a frame [m], from the cache for analysis."""
    with h5py.File(out / f"{garment}.h5") as cache:
        return cache["positions"][list(cache["frame_numbers"]).index(frame)]


def cost_and_error(options, folders, settings):
    """Seconds a frame of these runs of fabric.toml, and their distance from a run with twice the steps of `hero`.

    The distance is that at frame 8. Later each fold may fall to either side, whatever the steps are, and distances say little.
    """
    scene, last, exact = HOWTO / "fabric.toml", 24, options.work / "faster_exact"
    run(command(options.drapery, scene, exact, last, ["fabric=silk_light", "solver.preset=hero", "solver.steps_per_frame=32"]))
    texts = []
    for out, setting in zip(folders, settings):
        with tempfile.TemporaryDirectory() as work:
            seconds = run([*command(options.drapery, scene, Path(work) / "out", last, setting), "--threads", "1"])
        away = positions(out, "square", 8) - positions(exact, "square", 8)
        error = np.sqrt((away**2).sum(axis=1).mean())
        texts.append(f"{seconds / (last + 1):.2f} s a frame, {1e3 * error:.0f} mm off")
    return texts


class Chart:
    """A plot of curves, drawn four times as large as it is and then made smaller."""

    WIDTH, HEIGHT, LEFT, TOP, RIGHT, BOTTOM, FINE = 1450, 540, 84, 64, 30, 74, 4

    def __init__(self, title, across, up, most_across, most_up):
        self.picture = Image.new("RGB", (self.WIDTH * self.FINE, self.HEIGHT * self.FINE), "white")
        self.ink = ImageDraw.Draw(self.picture)
        self.most = most_across, most_up
        self.words((self.LEFT, 30), title, "#222222", "lm", 21)
        for most, vertical in ((most_across, True), (most_up, False)):
            step = next(step for step in (1, 2, 5, 10, 20, 50, 100, 200) if most / step <= 12)
            for mark in range(0, int(most) + 1, step):
                ends = [(mark, 0), (mark, most_up)] if vertical else [(0, mark), (most_across, mark)]
                self.curve(ends, LIGHT, 1)
                x, y = self.place(ends[0])
                self.words((x, y + 10) if vertical else (x - 12, y), str(mark), GREY, "mt" if vertical else "rm", 18)
        self.curve([(0, most_up), (0, 0), (most_across, 0)], GREY, 1.5)
        self.words((0.5 * (self.LEFT + self.WIDTH - self.RIGHT), self.HEIGHT - 14), across, "#222222", "mb", 20)
        self.words((self.LEFT + 12, self.TOP + 6), up, "#222222", "lt", 20)

    def place(self, point):
        return (self.LEFT + point[0] / self.most[0] * (self.WIDTH - self.LEFT - self.RIGHT),
                self.HEIGHT - self.BOTTOM - point[1] / self.most[1] * (self.HEIGHT - self.TOP - self.BOTTOM))

    def curve(self, points, colour, width):
        fine = [tuple(self.FINE * at for at in self.place(point)) for point in points]
        self.ink.line(fine, colour, round(width * self.FINE), joint="curve")

    def mark(self, point, words, colour, way):
        """A dot, and words that stand this far from it [pixels]."""
        x, y = self.place(point)
        x_words, y_words = x + way[0], y + way[1]
        self.ink.line([(self.FINE * x, self.FINE * y), (self.FINE * x_words, self.FINE * y_words)], colour, self.FINE)
        self.ink.ellipse([self.FINE * at for at in (x - 7, y - 7, x + 7, y + 7)], colour)
        self.words((x_words + (6 if way[0] > 0 else -6), y_words), words, colour, "lm" if way[0] > 0 else "rm", 20)

    def words(self, at, words, colour, anchor, size):
        self.ink.text([self.FINE * part for part in at], words, colour, ImageFont.load_default(size=size * self.FINE), anchor)

    def done(self):
        return self.picture.resize((self.WIDTH, self.HEIGHT), Image.Resampling.LANCZOS)


def digest(out, cache):
    return sha256((out / cache).read_bytes()).hexdigest()


def stopped_and_resumed(options):
    """Frames done by time: a run that is stopped by SIGTERM and resumed, beside one that is never stopped."""
    scene, stop_at, last = SAMPLES / "flag.toml", 48, 96
    stopped, never = options.work / "farm_stopped", options.work / "farm_never"
    if not stopped.is_dir():
        line = command(options.drapery, scene, stopped, last)
        process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        farm.reaches(stopped, process, stop_at)
        code, _ = farm.stop(process, signal.SIGTERM)
        if code != farm.STOPPED:
            sys.exit(f"{' '.join(line)}: stopped with exit code {code}, not {farm.STOPPED}")
        time.sleep(QUEUE)
        run(line)
    run(command(options.drapery, scene, never, last))
    (begin, before), (again, after) = moments(stopped)
    ((_, whole),) = moments(never)
    same = digest(stopped, "flag.abc") == digest(never, "flag.abc")
    title = f"flag.abc of both runs: {'the same bytes' if same else 'DIFFERENT bytes'} (SHA-256 {digest(never, 'flag.abc')[:16]}…)"
    chart = Chart(title, "seconds since the first start", "frames done", 1.04 * max(after[-1][0], whole[-1][0]), 105)
    end, reached = before[-1]
    chart.curve([(0.0, 0), *whole], GREY, 3)
    chart.curve([(begin, 0), *before], BLUE, 3.5)
    chart.curve([(end, reached), (again, after[0][1] - 1)], RED, 1.5)
    chart.curve([(again, after[0][1] - 1), *after], BLUE, 3.5)
    chart.mark(before[-1], f"frame {reached}: SIGTERM, exit code {farm.STOPPED}", RED, (40, 70))
    chart.mark((again, after[0][1] - 1), "the same command goes on", BLUE, (40, 40))
    chart.mark(after[-1], f"frame {after[-1][1]}: done, exit code 0", BLUE, (-40, 0))
    chart.mark(whole[-1], f"frame {whole[-1][1]}: never stopped, exit code 0", GREY, (-40, 0))
    return chart.done()


def two_processes(options):
    """Seconds of each frame for one process and for two, of one thread each, and the checksums of their caches."""
    scene, last = SAMPLES / "flag.toml", 96
    found = []
    for processes in (1, 2):
        out = options.work / f"two_machines_{processes}"
        line = [*command(options.drapery, scene, out, last), "--threads", "1"]
        run(line if processes == 1 else ["mpirun", "-n", str(processes), *line])
        ((begin, frames),) = moments(out)
        found.append((processes, begin, frames, digest(out, "flag.abc")))
    same = found[0][3] == found[1][3]
    title = f"flag.abc of both runs: {'the same bytes' if same else 'DIFFERENT bytes'} (SHA-256 {found[0][3][:16]}…, {found[1][3][:16]}…)"
    longest = max(frames[-1][0] for _, _, frames, _ in found)
    chart = Chart(title, "seconds since the start, with one thread for each process", "frames done", 1.04 * longest, 105)
    for (processes, begin, frames, _), colour in zip(found, (GREY, BLUE)):
        chart.curve([(begin, 0), *frames], colour, 3.5)
        seconds = (frames[-1][0] - begin) / len(frames)
        chart.mark(frames[-1], f"{processes} process{'es' if processes > 1 else ''}: {seconds:.2f} s a frame", colour, (-40, 0))
    return chart.done()


def page_of_a_wedge(options):
    """The upper part of the page of a wedge, in a browser: three fabrics on a rough ball and a slippery one."""
    out = options.work / "wedge"
    scene = ROOT / "sample_assets" / "howto" / "fabric.toml"
    run([options.drapery, "wedge", scene, "--vary", "fabric=silk_light,denim_11oz,leather_garment", "--vary", "body.ball.friction=0.1,0.6",
         "--out", out])  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "page.png"
        browser.photograph(out / "comparison.html", picture, (1240, 1500))
        with Image.open(picture) as whole:
            return whole.convert("RGB")


def plot_of_the_python_page(_):
    """The plot that the program of docs/howto/from_python.md saves, run with the wheel as its reader has it."""
    python = os.environ.get("DRAPERY_WHEEL_PYTHON")
    if not python:
        subprocess.run([ROOT / "packaging" / "install-wheel.sh"], check=True)
        python = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "python" / "venv" / "bin" / "python"
    page = (ROOT / "docs" / "howto" / "from_python.md").read_text()
    (plot,) = re.findall(r'savefig\("(.*?)"', page)
    with tempfile.TemporaryDirectory() as work:
        program = Path(work) / "page.py"
        program.write_text("\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL)))
        subprocess.run([python, program], check=True, cwd=work, env=os.environ | {"MPLBACKEND": "agg"}, stdout=subprocess.DEVNULL)
        with Image.open(Path(work) / plot) as picture:
            return picture.convert("RGB")


def panel_in_blender(options):
    """The panel of the add-on in Blender's window, with a run that is shown: the object beside shot and simulation.

    Between the two parts at the right Debian's Blender warns that it was built without Alembic; Blender's own has it and shows nothing there.
    """
    with tempfile.TemporaryDirectory() as work:
        blender_session.session(Path(work), options.drapery)
        with Image.open(Path(work) / "live.png") as picture:
            return columns_of_panel(picture.convert("RGB"))


def columns_of_panel(picture):
    """Two columns cut out of a picture of the window: parts between two heights, one below the other."""
    columns = [[picture.crop((520, top, 716, bottom)) for top, bottom in parts] for parts in (((344, 1297),), ((1424, 2176), (2252, 2478)))]
    height = max(sum(part.height for part in parts) for parts in columns)
    both = Image.new("RGB", (2 * 196 + 12, height), (48, 48, 48))
    for index, parts in enumerate(columns):
        top = 0
        for part in parts:
            both.paste(part, (index * (196 + 12), top))
            top += part.height
    return both.resize((round(1.25 * both.width), round(1.25 * both.height)), Image.Resampling.LANCZOS)


def page_of_a_run(options):
    """The page of `drapery view`: the dressed mannequin in the middle of a step, coloured by strain."""
    scene, frame = SAMPLES / "dressed_mannequin.toml", 1013
    out = options.work / "view"
    run(command(options.drapery, scene, out, frame, [f"assets={options.assets}"]))
    with tempfile.TemporaryDirectory() as folder:
        page, picture = Path(folder) / "page.html", Path(folder) / "page.png"
        run([options.drapery, "view", str(out), "--page", str(page)])
        act = f'if (viewer.shown()) {{ clearInterval(wait); viewer.setMode("strain"); viewer.show({frame}); }}'
        page.write_text(page.read_text().replace("</body>", f"<script>const wait = setInterval(() => {{ {act} }}, 50);</script></body>"))
        browser.photograph(page, picture, (1200, 800))
        with Image.open(picture) as whole:
            return whole.convert("RGB")
