"""Scenes that builds are timed on, and a run of one with what it says of itself."""

import json
import os
import re
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import measuring
from measuring import ROOT, SCENES

WOMAN = ROOT / "tests" / "scenes" / "dressed_woman.toml"
WOMAN_DATA = ROOT.parent / "shared" / "data" / "woman_walk_dance"
MANNEQUIN = SCENES / "dressed_mannequin.toml"

# A square metre of cloth of 1000 N/m and 10 µN m, written so that both builds read it.
SHEET = """drapery = 1
[shot]
fps = "24"
frames = "0-240"
[gravity]
[self_repulsion]
[self_collision]
{bodies}
[[garment]]
name = "sheet"
panel = {{ resolution = {cells}, side = 1.0, aspect = 1.0, center = [0, {height}, 0] }}
density = "200 g/m²"
[garment.stretch]
stiffness = "1000 N/m"
[garment.dihedral_bending]
stiffness = "10 µN·m"
{pins}
"""
# Parts of a frame and their stages, as `core/src/simulation/estimate.rs` has them.
PARTS = {
    "solves": ["B.1 velocity", "B.5 velocity"],
    "pairs": ["A neighbours", "B.2 self-repulsion", "B.8 self-repulsion", "C self-repulsion"],
    "collisions": ["C collisions"],
    "bodies": ["bodies and pins", "B.4 body collision", "B.7 body friction"],
}

PINS = '[[garment.pin]]\ncorners = ["i0j0", "inj0"]'
# The cloth starts a centimetre above the ball.
BALL = """[[body]]
name = "ground"
shape = { half_space = {} }
[[body]]
name = "ball"
shape = { sphere = { radius = 0.25 } }
position = [0, 0.25, 0]
friction = 0.3
"""

# Also as root, as in containers, and with more ranks than cores.
MPI = {name: "1" for name in ["OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM",
                              "OMPI_MCA_rmaps_base_oversubscribe"]}


def hung(cells):
    return SHEET.format(cells=cells, height=1.5, bodies="", pins=PINS)


def draped(cells):
    return SHEET.format(cells=cells, height=0.52, bodies=BALL, pins="")


def woman(quality):
    """The scene of the dressed woman in words that both builds know: fine garments, or light ones."""
    text = measuring.without_tables(WOMAN.read_text(), ["check"])
    text = re.sub(r'^data = .*$', f'data = "{WOMAN_DATA}"', text, flags=re.MULTILINE)
    return re.sub(r'^quality = .*$', f'quality = "{"" if quality == "fine" else "_lowres"}"', text, flags=re.MULTILINE)


def mannequin(assets):
    text = measuring.without_tables(MANNEQUIN.read_text(), ["check"])
    return re.sub(r'^assets = "[^"]*"', f'assets = "{assets}"', text, flags=re.MULTILINE)


class Run:
    """A run: CPU seconds of its process, and what it says of itself."""

    def __init__(self, program, scene, frames, settings=(), threads=1, ranks=1):
        with tempfile.TemporaryDirectory() as folder:
            folder = Path(folder)
            (folder / "scene.toml").write_text(scene)
            words = [str(program), "run", str(folder / "scene.toml"), "--frames", f"{frames[0]}-{frames[1]}"]
            words += ["--threads", str(threads), "--progress", "none", "--checkpoint-every", "1000h"]
            words += ["--out", str(folder / "out")]
            for setting in [*settings, 'output.format=["h5"]']:
                words += ["--set", setting]
            if ranks > 1:
                words = ["mpirun", "-n", str(ranks), "--bind-to", "none", *words]
            before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
            done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, **MPI})
            self.wall = time.monotonic() - started
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            if done.returncode != 0:
                raise Failed(f"{shlex.join(words)}\nended with {done.returncode}\n{done.stdout}{done.stderr}")
            lines = [json.loads(line) for line in (folder / "out" / "run.jsonl").read_text().splitlines()]
        self.cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        self.frames = [line for line in lines if line["record"] == "frame"]
        self.stages = {stage["stage"]: stage["seconds"] for stage in lines[-1]["stages"]}
        print(f"  {Path(program).name}: {self.cpu:.2f} CPU s, {len(self.frames)} frames, {self.sum('steps')} steps",
              file=sys.stderr, flush=True)

    def a_frame(self):
        return self.cpu / len(self.frames)

    def sum(self, name):
        return sum(frame[name] for frame in self.frames)

    def count(self, name):
        return sum(frame["counts"].get(name, 0) for frame in self.frames)

    def spent(self, stages):
        """Seconds by the clock in some stages."""
        return sum(self.stages.get(stage, 0.0) for stage in stages)

    def strain(self):
        """The largest strain of all frames, and the largest 99.9th percentile where the record has it."""
        largest = max((frame["max_strain"]["strain"] for frame in self.frames if frame.get("max_strain")), default=0.0)
        percentiles = [garment["p99_9"] for frame in self.frames for garment in frame.get("strains", [])]
        return f"{largest:.3f}" + (f" ({max(percentiles):.3f})" if percentiles else "")


class Failed(Exception):
    """A run that ended badly: its row is left out, the others go on."""
