"""Steps of ranks on two machines against the latency between them, and what that says of 64 ranks.

The machines are network namespaces with a cable that delays (`tests/oracle/machines.py`).
"""

import functools
import math
import os
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np

from measure.page import Table
from measure.runs import LONG, OPTIONS, ROOT, SHORT, TODAY, Failed, Run
from measure.scenes import TESTS, on_the_ball, with_parameters

sys.path.append(str(ROOT / "tests" / "oracle"))
from machines import Machines, NoMachines  # noqa: E402

PAGE = "dev/measurements/ranks.md"
# One way [s], and the rate each way [bit/s].
DELAYS, RATE = (0.0, 50e-6, 500e-6), 10e9
STEPS = {"short": SHORT, "long": LONG}
BALL, LAYERS = 158, 28
# What is simulated: words for it, the scene, its frames, and its triangles.
SCENES = {
    "ball": ("spinning ball, 50,000 triangles", lambda: on_the_ball(BALL, 240), (0, 3), 2 * BALL**2),
    "layers": ("four layers on a ball, 6,272 triangles",
               lambda: with_parameters((TESTS / "folded_on_a_ball.toml").read_text(), resolution=LAYERS), (0, 4), 8 * LAYERS**2),
}
KINDS = [(scene, steps) for scene in SCENES for steps in STEPS]
# The shots of the model: millions of triangles, ranks, and latencies of their networks [s].
MILLIONS, MANY, NETWORKS = (2, 16), 64, (1.5e-6, 25e-6, 50e-6)


def a_step(made):
    """Milliseconds of a step."""
    return made.a_later_step()[0]


@functools.cache
def runs(scene, steps, ranks, delay):
    """The latency of one way over TCP [s], the middle of many; and the fastest of `--repeat` runs, on one rank without a network."""
    _, words, frames, _ = SCENES[scene]
    frames = (frames[0], min(frames[1], frames[0] + max(2, OPTIONS.frames)) if OPTIONS.frames else frames[1])
    with tempfile.TemporaryDirectory() as folder:
        try:
            machines = Machines(Path(folder), delay, RATE) if ranks > 1 else None
        except NoMachines as why:
            raise Failed(str(why)) from why
        try:
            latency = statistics.median(machines.round_trips(2000)) / 2 if machines else 0.0
            made = [Run(TODAY, words(), frames, STEPS[steps], ranks=ranks, machines=machines) for _ in range(OPTIONS.repeat)]
        finally:
            if machines:
                machines.close()
    return latency, min(made, key=a_step)


def counted(scene, steps, ranks):
    """Collective operations and exchanges with neighbours of a step and rank."""
    _, together, exchanges = runs(scene, steps, ranks, DELAYS[0])[1].a_later_step("collectives", "exchanges")
    return together, exchanges / ranks


def work(scene, steps):
    """Milliseconds of a step of one rank alone."""
    return a_step(runs(scene, steps, 1, None)[1])


def modelled(scene, steps, ranks, latency):
    """Milliseconds of a step: the work divided among the ranks, or among the cores if these are fewer, and a latency for every
    collective operation and exchange. No figure in it is fitted."""
    return work(scene, steps) / min(ranks, os.cpu_count()) + 1e3 * latency * sum(counted(scene, steps, ranks))


def against_delay(scene, steps, ranks):
    def measure():
        lines = []
        for delay in DELAYS:
            latency, made = runs(scene, steps, ranks, delay)
            time, messages, sent, together = made.a_later_step("messages", "bytes_sent", "collectives")
            lines.append([f"{1e6 * delay:.0f}", f"{1e6 * latency:.0f}", f"{time:.1f}", f"{modelled(scene, steps, ranks, latency):.1f}",
                          f"{messages / ranks:.0f}", f"{sent / ranks / 1024:.0f}", f"{together:.0f}"])
        return lines

    return measure


def fitted(scene, steps, ranks):
    """Milliseconds of a step without latency, and the number of latencies one after the other: least squares."""
    latencies, times = zip(*((latency, a_step(made)) for latency, made in (runs(scene, steps, ranks, delay) for delay in DELAYS)))
    number, rest = np.polyfit([1e3 * latency for latency in latencies], times, 1)
    return rest, number


def latencies(scene, steps, ranks):
    def measure():
        rest, number = fitted(scene, steps, ranks)
        together, exchanges = counted(scene, steps, ranks)
        return [f"{work(scene, steps):.1f}", f"{rest:.1f}", f"{number:.0f}", f"{together:.0f}", f"{exchanges:.0f}",
                f"{number / (together + exchanges):.2f}"]

    return measure


def many(scene, steps, millions):
    """A collective operation of 64 ranks is six messages one after the other. As many of the counted latencies are met one after the
    other as with four ranks."""

    def measure():
        together, exchanges = counted(scene, steps, 4)
        met = fitted(scene, steps, 4)[1] / (together + exchanges)
        number = met * (math.log2(MANY) * together + exchanges)
        alone = work(scene, steps) * 1e6 * millions / SCENES[scene][3]
        cells = [f"{alone / MANY:.1f}", f"{number:.0f}"]
        for latency in NETWORKS:
            step = alone / MANY + 1e3 * latency * number
            cells.append(f"{step:.1f} ({100 * alone / MANY / step:.0f} %)")
        return cells

    return measure


def what(scene, steps, ranks=None):
    return f"{SCENES[scene][0]}, {steps} steps" + (f", ranks: {ranks}" if ranks else "")


def rows(function):
    """A row for each scene, integrator and number of ranks."""
    return {f"{function.__name__}-{scene}-{steps}-{ranks}": (what(scene, steps, ranks), function(scene, steps, ranks))
            for scene, steps in KINDS for ranks in (2, 4)}


TABLES = [
    Table(PAGE, "machines", ["delay [µs]", "latency [µs]", "ms a step", "model [ms]", "messages of a rank and step",
                             "kB of a rank and step", "collective operations a step"], rows(against_delay)),
    Table(PAGE, "latencies", ["1 rank [ms a step]", "t₀ [ms]", "n", "collective operations a step", "exchanges a step",
                              "n of those counted"], rows(latencies)),
    Table(PAGE, "many", ["work of a rank [ms]", "latencies of a step", *(f"{1e6 * latency:g} µs [ms a step]" for latency in NETWORKS)],
          {f"many-{scene}-{steps}-{millions}": (f"{millions} million triangles as in {what(scene, steps)}", many(scene, steps, millions))
           for scene, steps in KINDS for millions in MILLIONS}),
]
