"""The remedies of docs/guide/troubleshooting.md, each on a small scene before and after. Takes a minute or two."""

import json
import re
import signal
import subprocess
import tempfile
from pathlib import Path

import h5py
import numpy as np

from measure.page import Block, table
from measure.runs import TODAY, Failed, run
from measure.scenes import HOWTO, SAMPLES

SHEET, FABRIC, FLAG = SAMPLES / "hanging_sheet.toml", HOWTO / "fabric.toml", SAMPLES / "flag.toml"
BALL, RADIUS = np.array([0.0, 0.6, 0.0]), 0.15


def last_positions(folder):
    """Positions of the last frame [m], with Y up, and the triangles."""
    with h5py.File(next(folder.glob("*.h5"))) as cache:
        return cache["positions"][-1].astype(float), cache["triangles"][:]


def largest_strain(made):
    return f"largest strain {100 * max(frame['max_strain']['strain'] for frame in made.frames):.1f} %"


def energy(unit, factor, digits):
    return lambda made: f"kinetic energy of the last frame {factor * made.frames[-1]['kinetic_energy']:{digits}} {unit}"


def lowest(made):
    return f"lowest point {1e3 * last_positions(made.out)[0][:, 1].min():.0f} mm high"


def inside_the_ball(made):
    points, triangles = last_positions(made.out)
    depth = RADIUS - np.linalg.norm(points[triangles].mean(axis=1) - BALL, axis=1).min()
    return f"middles of faces up to {1e3 * max(depth, 0.0):.1f} mm inside the ball"


def gap_to_the_ball(made):
    return f"closest vertex {1e3 * (np.linalg.norm(last_positions(made.out)[0] - BALL, axis=1).min() - RADIUS):.1f} mm from the ball"


def steps(made):
    return f"{made.steps / len(made.frames):.0f} steps a frame"


# Symptom, scene, frames, settings of both, what is added after, what is looked at.
TRIES = [
    ("it jitters and never comes to rest", SHEET, (1001, 1049), ["resolution=16"], ["ether_drag.rate=2"], energy("mJ", 1e3, ".2f")),
    ("it stretches like rubber", SHEET, (1001, 1025), ["resolution=16", "garment.sheet.material=silk_light"],
     ["garment.sheet.strain_limit.limit=0.03"], largest_strain),
    ("it sticks", FABRIC, (0, 24), ["resolution=20", "body.ball.friction=1"], ["body.ball.friction=0"], lowest),
    ("it hangs in the air", FABRIC, (0, 24), ["resolution=20", "body.ball.thickness=20 mm"], ["body.ball.thickness=1 mm"], gap_to_the_ball),
    ("it goes through the body", FABRIC, (0, 24), ["resolution=10"], ["resolution=40"], inside_the_ball),
    ("the same", FABRIC, (0, 24), ["resolution=10"], ["body.ball.thickness=15 mm"], inside_the_ball),
    ("folds and sleeves collapse", FABRIC, (0, 24), ["resolution=20"], ["garment.square.dihedral_bending.stiffness=4e-4"], lowest),
    ("it explodes: a wind in cm/s", FLAG, (0, 24), ["resolution=10", "speed=600"], ["speed=6"], energy("J", 1, ".3g")),
    ("it is slow", SHEET, (1001, 1025), ["resolution=24"], ["solver.preset=preview"], steps),
]


def tried(symptom, scene, frames, settings, added, look):
    before, after = (look(run(scene, frames, (*settings, *extra))) for extra in ([], added))
    code = lambda words: ", ".join(f"`{word}`" for word in words)
    return [symptom, f"`{scene.stem}`, {code(settings)}", before, code(added), after]


def start(scene, frames, settings, folder, *more):
    """A run as a process whose lines can be read; its exit code may be any."""
    command = [TODAY, "run", scene, "--frames", frames, "--out", folder, *more, *(f"--set={setting}" for setting in settings)]
    return subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def ended(process):
    """Exit code of a run with its first line that says an error, and all that it said."""
    said = process.communicate()[0]
    error = next((line.removeprefix("Error: ") for line in said.splitlines() if line.startswith("Error: ")), "")
    return f"exit code {process.returncode}" + (f": {error}" if error else ""), said


def stopped_and_resumed(folder):
    """75: SIGTERM in the middle, then the same command again; and once without a stop, to compare."""
    settings, frames = ["resolution=24"], "1001-1025"
    process = start(SHEET, frames, settings, folder / "run")
    line = next(line for line in process.stdout if line.startswith("frame 1006"))
    process.send_signal(signal.SIGTERM)
    before, _ = ended(process)
    after, _ = ended(start(SHEET, frames, settings, folder / "run"))
    ended(start(SHEET, frames, settings, folder / "whole"))
    same = np.array_equal(*(last_positions(folder / name)[0] for name in ("run", "whole")))
    after += f", frames as without the stop: {'the same bits' if same else 'OTHERS'}"
    where = f"`hanging_sheet`, `resolution=24`, SIGTERM after {' '.join(line.split()[:2]).split('/')[0]}"
    return [["it stops with 75", where, before, "the same command again", after]]


def given_up(folder):
    """80: steps get shorter than the shortest that is allowed."""
    settings = ["resolution=10", "solver.min_dt=5e-4"]
    before, said = ended(start(FLAG, "0-24", [*settings, "speed=600"], folder / "run"))
    if not list((folder / "run" / "debug").glob("*.toml")):
        raise Failed(f"a run that gave up left no bundle: {said}")
    after, _ = ended(start(FLAG, "0-24", [*settings, "speed=6"], folder / "mended"))
    before = re.sub(r"time [\d.]+ s: ", "", before)
    return [["it stops with 80", "`flag`, `resolution=10`, `solver.min_dt=5e-4`, `speed=600`", f"{before}; a bundle in `OUT/debug`",
             "`speed=6`: a wind in m/s", after]]


def not_clean(folder):
    """81: a count that should be zero is not."""
    limited, sweeps = ["resolution=12", "garment.sheet.strain_limit.limit=0.03"], "garment.sheet.strain_limit.sweeps=1"
    before, said = ended(start(SHEET, "1001-1013", [*limited, sweeps], folder / "run", "--strict"))
    count = re.search(r"strain_over_limit (\d+)", said.partition("quality limits")[2])
    after, _ = ended(start(SHEET, "1001-1013", limited, folder / "mended", "--strict"))
    where = ", ".join(f"`{setting}`" for setting in [*limited, sweeps])
    return [["it stops with 81", f"`hanging_sheet`, {where}, `--strict`", f"{before}: `strain_over_limit` {count[1]}",
             "without `sweeps`", after]]


def info(cache):
    return subprocess.run([TODAY, "info", str(cache)], capture_output=True, text=True, check=True).stdout


def extents(cache):
    """Bounds of the first sample as the file has them: numbers without a unit."""
    bounds = re.findall(r"\[([^\]]*)\]", info(cache).partition("bounds of the first sample")[2])[:2]
    low, high = (json.loads(f"[{text}]") for text in bounds)
    return f"extents in the file {' × '.join(f'{round(b - a, 3):g}' for a, b in zip(low, high))}"


def rate(cache):
    return f"samples at {re.search(r'samples: .* at ([0-9.]+) fps', info(cache))[1]} frames a second"


def loaded_wrongly(folder):
    """Rows for properties of a cache that an application reads wrongly: its unit, its axis, its frame rate."""
    for name, settings in (("run", []), ("other", ["shot.fps=25"])):
        ended(start(FLAG, "0-4", ["resolution=10", *settings], folder / name))
    cache, rows = folder / "run" / "flag.abc", []
    for symptom, arguments in (("the cache is 100 times too small in an application of centimetres", ["--length", "cm"]),
                               ("it lies on its side", ["--up", "Z"])):
        new = folder / f"{arguments[0]}.abc"
        subprocess.run([TODAY, "convert", str(cache), str(new), *arguments], check=True, capture_output=True)
        remedy = f"`drapery convert in.abc out.abc {' '.join(arguments)}`"
        rows.append([symptom, "`flag`, `resolution=10`", extents(cache), remedy, extents(new)])
    after = rate(folder / "other" / "flag.abc")
    return [*rows, ["it plays at the wrong speed in a shot of 25", "`flag`, `resolution=10`", rate(cache), "`shot.fps=25`", after]]


def all_tries():
    rows = [tried(*each) for each in TRIES]
    with tempfile.TemporaryDirectory() as folder:
        for provoke in (stopped_and_resumed, given_up, not_clean, loaded_wrongly):
            rows += provoke(Path(folder) / provoke.__name__)
    return table(["symptom", "scene", "before", "change", "after"], rows)


TABLES = [Block("guide/troubleshooting.md", "symptoms", "remedies, before and after", all_tries)]
