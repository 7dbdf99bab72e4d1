"""What the command does with files: conversions, differences, reports, and what a file holds."""

from __future__ import annotations

import json
import logging
import os
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

from . import _native
from ._arrays import PathLike
from ._caches import Units, _rate
from ._errors import UsageError

_log = logging.getLogger("drapery")


@dataclass(frozen=True)
class Conversion:
    """A cache that was written from another one."""

    path: Path
    """The new cache."""
    frames: tuple[int, int]
    """Its first and last frame."""
    points: int
    """Number of its points."""
    units: Units
    """Its unit and axis."""
    left_out: list[str]
    """What the old cache holds of its meshes and the new one does not, a sentence each."""


def convert(
    source: PathLike,
    out: PathLike,
    mesh: str | None = None,
    frames: tuple[int, int] | None = None,
    length: str | None = None,
    up: str | None = None,
    fps: float | Fraction | None = None,
    overwrite: bool = False,
) -> Conversion:
    """Writes a cache as another one, as ``drapery convert`` does; the extension of ``out`` says its format.

    ``mesh`` is the path of the mesh where there are several, ``frames`` are the first and the last one, ``length`` (``mm``, ``cm``,
    ``in``, ``ft``, ``m``) and ``up`` (``Y``, ``Z``) are unit and axis of the new cache; what is left out stays. ``fps`` is the rate in
    frames per second of a file that does not say it. What the new cache cannot hold is in ``left_out``, and logged.

    Raises InputError for a cache that is damaged or missing, OutputError if ``out`` is there and ``overwrite`` is not set, or the disk
    refuses; UsageError for a mesh or frames that are not there.
    """
    rate = None if fps is None else _rate(fps)
    request: dict[str, Any] = {
        "from": os.fspath(source),
        "to": os.fspath(out),
        "object": mesh,
        "frames": frames,
        "length": length,
        "up": up,
        "fps": None if rate is None else (rate.numerator, rate.denominator),
        "overwrite": overwrite,
    }
    written, points, units, left_out = _native.convert(request)
    for sentence in left_out:
        _log.warning("%s", sentence)
    return Conversion(Path(out), written, points, Units(*units), left_out)


@dataclass(frozen=True)
class FrameDistance:
    """How far the vertices of two caches are from each other at a frame."""

    frame: int
    """Its number."""
    behind: float
    """How far behind it the sample is, in frames: 0 for the frame itself."""
    max: float
    """Largest distance between a vertex and its like [m]."""
    rms: float
    """Root of the mean square distance over all vertices [m]."""
    max_velocity: float | None
    """Largest difference between velocities [m/s]; None where a side stores none."""
    vertex: int
    """The vertex that is farthest away."""
    mesh: str
    """Path of its mesh."""


@dataclass(frozen=True)
class FileDifference:
    """How far two files are from each other."""

    a: str
    """First file."""
    b: str
    """Second file."""
    verdict: str
    """As of ``Difference``."""
    notes: list[str]
    """What the two do not have in common, and differences that are no distances."""
    worst: dict[str, Any] | None
    """The vertex that is farthest from its like: ``mesh``, ``vertex``, ``frame``, ``behind``, ``distance`` [m]."""
    frames: list[FrameDistance] = field(repr=False)
    """Every frame that both have; empty for files with the same bytes, and for checkpoints."""
    datasets: list[dict[str, Any]] = field(repr=False)
    """Arrays that differ, of checkpoints: ``name``, ``count``, ``values``, ``max``, ``first``."""


@dataclass(frozen=True)
class Difference:
    """How far two results are from each other."""

    verdict: str
    """The worst of all parts: ``byte-equal``, ``equal``, ``within-tolerance`` or ``differs``."""
    tolerance: float
    """Largest distance that was allowed [m]."""
    parts: list[FileDifference]
    """What was compared with what."""

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than the tolerance."""
        return self.verdict != "differs"


def diff(a: PathLike, b: PathLike, tolerance: float = 0.0) -> Difference:
    """How far two caches, checkpoints or folders of runs are from each other, as ``drapery diff`` says; of any format, unit and axis.

    ``tolerance`` is the distance that is allowed [m]. Raises InputError if one is missing, damaged, or not of the kind of the other.
    """
    if not tolerance >= 0.0:
        raise UsageError(f"`tolerance` is {tolerance}\n  help: give a distance in metres, 0 or more")
    found = json.loads(_native.diff(os.fspath(a), os.fspath(b), tolerance))
    parts = [
        FileDifference(**{**part, "frames": [FrameDistance(**frame) for frame in part["frames"]]}) for part in found["parts"]
    ]
    return Difference(found["verdict"], found["tolerance"], parts)


def report(folder: PathLike) -> Path:
    """Writes ``report.html`` about a run into its folder, as ``drapery report`` does; returns its path.

    Raises InputError if the folder holds no run, OutputError if the page cannot be written.
    """
    return _native.report(os.fspath(folder))


@dataclass(frozen=True)
class MeshInfo:
    """A mesh of a file, in the file's own unit and axis."""

    path: str
    """Full path of the object."""
    points: int
    """Number of points of the first sample."""
    faces: tuple[int, int, int]
    """Number of faces with three, four, and more corners."""
    topology: str
    """Whether points and faces change."""
    samples: int
    """Number of samples of the points."""
    times: tuple[float, float]
    """Times of the first and the last sample [s]."""
    bounds: list[list[float]] | None
    """Smallest and largest coordinates of the first sample in the world."""
    uvs: list[Any] | None
    """Name of the texture coordinates and the number of their values."""
    face_sets: dict[str, int]
    """Face sets and their number of faces."""
    attributes: list[str]
    """Names of other attributes."""
    velocities: bool
    """Whether velocities are stored."""
    problem: str | None
    """Why it cannot be read, if so; the rest is then empty."""


@dataclass(frozen=True)
class FileInfo:
    """What a file holds."""

    format: str
    """Its format."""
    properties: dict[str, str]
    """Who wrote it, how it counts frames, and the like."""
    meshes: list[MeshInfo]
    """Its meshes."""
    others: dict[str, str]
    """Objects that are no meshes: path and kind."""


def info(path: PathLike) -> FileInfo:
    """What a mesh or cache file holds, as ``drapery info`` says. Raises InputError if it is missing or cannot be read."""
    found = json.loads(_native.info(os.fspath(path)))
    meshes = [
        MeshInfo(
            **{**mesh, "faces": tuple(mesh["faces"]), "times": tuple(mesh["times"]), "face_sets": dict(mesh["face_sets"])}
        )
        for mesh in found["meshes"]
    ]
    return FileInfo(found["format"], dict(found["properties"]), meshes, dict(found["others"]))
