"""Costs and benefits of many ranks, on the spinning ball and the folded stack; `latency` adds those of ranks on two machines."""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from measure import latency
from measure.page import Table
from measure.runs import ROOT, SHORT, TODAY, Run, alternating, run
from measure.scenes import film, folded_stack, on_the_ball

PAGE = "dev/measurements/ranks.md"
ON = {"1 rank, 1 thread": {"ranks": 1, "threads": 1}, "1 rank, 2 threads": {"ranks": 1, "threads": 2},
      "2 ranks, 1 thread each": {"ranks": 2, "threads": 1}}


def speed(contact):
    """200,000 triangles."""

    def measure():
        runs = alternating(on_the_ball(316, 60, contact), (0, 2), [(TODAY, (), more) for more in ON.values()])
        a_step = lambda made, *stages: 1e3 * made.clock(*stages) / made.steps
        whole = [a_step(made, "simulate") for made in runs]
        lines = [["all", *(f"{one:.1f}" for one in whole)], ["times faster", *(f"{whole[0] / one:.2f}" for one in whole)]]
        return lines + [[stage, *(f"{a_step(made, stage):.2f}" for made in runs)] for stage in runs[0].stages[:9]]

    return measure


def measured_memory(scene, frames, **more):
    """A run, and the most memory that each of its ranks took [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "drapery"
        program.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m measure.ranks {folder} {TODAY} "$@"\n')
        program.chmod(0o755)
        made = Run(program, scene, frames, **more)
        return made, [int(path.read_text()) / 1024 for path in Path(folder).glob("rank*")]


def memory(ranks):
    """Most memory of a rank at 10⁶ triangles."""

    def measure():
        made, taken = measured_memory(on_the_ball(707, 600), (0, 1), ranks=ranks)
        return [f"{max(taken):.0f}", f"{sum(taken) / ranks:.0f}", made.steps]

    return measure


def traffic(scene, frames, ranks):
    """Messages, bytes and collective operations of a step."""

    def measure():
        made = run(scene(), frames, ranks=ranks)
        _, messages, sent, together, iterations = made.a_later_step("messages", "bytes_sent", "collectives", "cg_iterations")
        return [f"{figure:.1f}" for figure in (messages / ranks, sent / ranks / 1024, together, iterations)]

    return measure


def large(**on):
    """Two million triangles."""

    def measure():
        made, taken = measured_memory(on_the_ball(1000, 600), (0, 2), **on)
        counts = [made.count(name) for name in ("body_contacts", "collision_steps")]
        return [made.steps, f"{made.clock('simulate') / made.steps:.2f}", f"{sum(taken):.0f}", f"{made.wall:.0f}", *counts]

    return measure


def second_of_film(**on):
    """Two million triangles in contact for 24 frames, crossings judged by libigl in the cache."""

    def measure():
        # In the folder that `latency` adds to the path.
        from crossings import Cloth

        made, taken = measured_memory(film(), (0, 24), settings=SHORT, **on)
        seconds = [frame["seconds"] for frame in made.frames]
        cloth = Cloth.of_run(made.out)
        crossings = sum(len(cloth.crossings(index)) for index in range(len(cloth.frames)))
        counts = [f"{made.count(name):,}" for name in ("body_contacts", "repulsions", "collision_hits")]
        return [len(seconds), made.steps, f"{sum(seconds) / len(seconds):.0f}", f"{max(seconds):.0f}", f"{made.wall / 60:.0f}", f"{sum(taken):.0f}",
                *counts, made.retried(), f"{made.crossings()}, {crossings}"]

    return measure


TABLES = [
    Table(PAGE, "speed", ["ms a step", *ON], {
        "free": ("without contact", speed(False)), "contact": ("with contact", speed(True))}),
    Table(PAGE, "memory", ["most of a rank [MB]", "mean [MB]", "steps"], {
        f"memory_{ranks}": (f"{ranks} rank{'s' * (ranks > 1)}", memory(ranks)) for ranks in (1, 2, 4, 8)}),
    Table(PAGE, "traffic", ["messages of a rank and step", "kB of a rank and step", "collective operations a step", "iterations a step"], {
        **{f"ball_{ranks}": (f"spinning ball, ranks: {ranks}", traffic(lambda: on_the_ball(316, 240), (0, 2), ranks))
           for ranks in (1, 2, 4, 8, 16)},
        **{f"stack_{ranks}": (f"folded stack, ranks: {ranks}", traffic(folded_stack, (0, 6), ranks)) for ranks in (2, 4)},
    }),
    Table(PAGE, "large", ["steps", "s a step", "memory of all [MB]", "s in all", "body contacts", "collision steps"], {
        "large_threads": ("1 rank, 2 threads", large(threads=2)), "large_ranks": ("2 ranks, 1 thread each", large(ranks=2))}),
    Table(PAGE, "film", ["frames", "steps", "s a frame", "slowest", "minutes in all", "memory [MB]", "`body_contacts`", "`repulsions`",
                         "`collision_hits`", "retried", "crossings counted, judged"], {
        "film": ("four layers of 4 m by 4 m on a ball of 2 m, 2 threads", second_of_film(threads=2))}),
    *latency.TABLES,
]


if __name__ == "__main__":
    # One rank of `measured_memory`: runs the command, and writes down the most memory that it took [kB].
    code = subprocess.call(sys.argv[2:])
    rank = os.environ.get("OMPI_COMM_WORLD_RANK", "0")
    Path(sys.argv[1], f"rank{rank}").write_text(str(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss))
    sys.exit(code)
