"""Work of the command on files: conversions, differences, reports, and the contents of a file."""

from __future__ import annotations

import json
import logging
import math
import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

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
    """Contents of the old cache's meshes that the new cache lacks, a sentence each."""
    doubts: list[str]
    """Doubts about the units of the old cache, a sentence each."""


def convert(
    source: PathLike,
    out: PathLike,
    object: str | None = None,
    frames: tuple[int, int] | None = None,
    from_length: str | None = None,
    from_up: str | None = None,
    length: str | None = None,
    up: str | None = None,
    fps: float | Fraction | None = None,
    triangles: bool = False,
    overwrite: bool = False,
) -> Conversion:
    """Writes a cache as another one, as ``drapery convert`` does; the extension of ``out`` says its format.

    The arguments are the options of the command. ``object`` is the path of the mesh where there are several, ``frames`` are the
    first and the last one. ``from_length`` (``mm``, ``cm``, ``in``, ``ft``, ``m``) and ``from_up`` (``Y``, ``Z``) are unit and axis of
    the old cache whatever it says of itself, ``length`` and ``up`` those of the new one, which has those of the old one when left
    out. ``fps`` is the rate in frames per second of a file that does not say it. ``triangles`` writes the triangles that were
    simulated in the place of the faces. What is in ``left_out`` and ``doubts`` is logged.

    Raises InputError for a cache that is damaged or missing or lacks this mesh or a frame, OutputError if ``out`` is there and
    ``overwrite`` is not set, or the disk refuses; UsageError for a unit, axis or rate that there is not.
    """
    rate = None if fps is None else _rate(fps)
    request: dict[str, Any] = {
        "from": os.fspath(source),
        "to": os.fspath(out),
        "object": object,
        "frames": frames,
        "from_length": from_length,
        "from_up": from_up,
        "length": length,
        "up": up,
        "fps": None if rate is None else (rate.numerator, rate.denominator),
        "triangles": triangles,
        "overwrite": overwrite,
    }
    written, points, units, left_out, doubts = _native.convert(request)
    for sentence in doubts + left_out:
        _log.warning("%s", sentence)
    return Conversion(Path(out), written, points, Units(*units), left_out, doubts)


@dataclass(frozen=True)
class FrameDistance:
    """Distance between the vertices of two caches at a frame."""

    frame: int
    """Its number."""
    behind: float
    """Time of the sample after the frame, in frames: 0 for the frame itself."""
    max: float
    """Largest distance between a vertex and its like [m]; infinite where a side holds no number."""
    rms: float
    """Root of the mean square distance over all vertices [m]."""
    max_velocity: float | None
    """Largest difference between velocities [m/s]; None where a side stores none."""
    vertex: int
    """The vertex that is farthest away."""
    mesh: str
    """Path of its mesh."""


@dataclass(frozen=True)
class WorstVertex:
    """The vertex that is farthest from its like."""

    mesh: str
    """Path of the mesh in the cache, or name of the array of a checkpoint."""
    vertex: int
    """Number of the vertex, from 0."""
    frame: int
    """Frame; that of the checkpoint, for one."""
    behind: float
    """Time of the sample after the frame, in frames."""
    distance: float
    """Distance [m]; infinite where a side holds no number."""


@dataclass(frozen=True)
class ArrayDifference:
    """Difference between two checkpoints in an array."""

    name: str
    """Section and array: ``state/positions``."""
    count: int
    """Number of values that differ."""
    values: int
    """Number of values."""
    max: float
    """Largest difference, in the array's own unit."""
    first: int
    """Index of the first value that differs."""


@dataclass(frozen=True)
class FileDifference:
    """Difference between two files."""

    a: str
    """First file."""
    b: str
    """Second file."""
    verdict: str
    """As of ``Difference``."""
    notes: list[str]
    """Contents that only one file has, and differences that are no distances."""
    worst: WorstVertex | None
    """The vertex that is farthest from its like, if any is away from it."""
    frames: list[FrameDistance] = field(repr=False)
    """Every frame that both have, and every sample between; empty for files with the same bytes, and for checkpoints."""
    arrays: list[ArrayDifference] = field(repr=False)
    """Arrays that differ, of checkpoints."""


@dataclass(frozen=True)
class Difference:
    """Difference between two results."""

    verdict: str
    """The worst of all parts: ``byte-equal``, ``equal``, ``within-tolerance`` or ``differs``."""
    tolerance: float
    """Largest distance that was allowed [m]."""
    parts: list[FileDifference]
    """Differences of the files, a pair each."""

    @property
    def same(self) -> bool:
        """Whether nothing differs by more than the tolerance."""
        return self.verdict != "differs"


def diff(a: PathLike, b: PathLike, tolerance: float = 0.0) -> Difference:
    """Distances between two caches, checkpoints or folders of runs, as ``drapery diff`` says; of any format, unit and axis.

    ``tolerance`` is the distance that is allowed [m]. Raises InputError if one is missing, damaged, or not of the kind of the other.
    """
    if not (tolerance >= 0.0 and math.isfinite(tolerance)):
        raise UsageError(f"`tolerance` is {tolerance}\n  help: give a distance in metres, 0 or more")
    found = json.loads(_native.diff(os.fspath(a), os.fspath(b), tolerance))
    return Difference(found["verdict"], found["tolerance"], [_file_difference(part) for part in found["parts"]])


def _file_difference(part: dict[str, Any]) -> FileDifference:
    worst = None if part["worst"] is None else WorstVertex(**_finite_or_not(part["worst"], "distance"))
    frames = [FrameDistance(**_finite_or_not(frame, "max", "rms")) for frame in part["frames"]]
    arrays = [ArrayDifference(**_finite_or_not(array, "max")) for array in part["datasets"]]
    return FileDifference(part["a"], part["b"], part["verdict"], part["notes"], worst, frames, arrays)


def _finite_or_not(numbers: dict[str, Any], *names: str) -> dict[str, Any]:
    """The same with the infinite distances, for which JSON has but null."""
    return {name: math.inf if name in names and value is None else value for name, value in numbers.items()}


def report(folder: PathLike) -> Path:
    """Writes ``report.html`` about a run into its folder, as ``drapery report`` does; returns its path.

    Raises InputError if the folder holds no run, OutputError if the page cannot be written.
    """
    return _native.report(os.fspath(folder))


def compare(folders: Iterable[PathLike], page: PathLike = "comparison.html") -> Path:
    """Writes a page with runs side by side, as ``drapery report A B`` does, and its table beside it as CSV; returns the page's path.

    Raises InputError if a folder holds no run, OutputError if a file cannot be written or is there and is no page or table of Drapery.
    """
    return _native.compare([os.fspath(folder) for folder in folders], os.fspath(page))


def view(folder: PathLike, page: PathLike) -> Path:
    """Writes a page that plays the frames of a run in a browser, as ``drapery view --page`` does; returns its path.

    Raises InputError if the folder holds no run or no frame, OutputError if another file has this name.
    """
    _native.view(os.fspath(folder), os.fspath(page))
    return Path(page)


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
    bounds: tuple[list[float], list[float]] | None
    """Smallest and largest coordinates of the first sample in the world."""
    uvs: tuple[str, int] | None
    """Name of the texture coordinates and the number of their values."""
    face_sets: dict[str, int]
    """Face sets and their number of faces."""
    normals: Literal["no", "smooth", "split"]
    """Normals of the first sample: none, the same for all faces at a point, or several at the points of hard edges."""
    attributes: list[str]
    """Names of other attributes."""
    velocities: bool
    """Whether velocities are stored."""
    problem: str | None
    """Why it cannot be read, if so; the rest is then empty."""


@dataclass(frozen=True)
class ChannelInfo:
    """A property of one number or of three that changes over time, which a number of a scene can follow."""

    channel: str
    """Path of the object and name of the property, as a scene writes them: ``/control.slip``."""
    numbers: int
    """Numbers of a sample."""
    samples: int
    """Number of samples."""


@dataclass(frozen=True)
class FileInfo:
    """Contents of a file."""

    format: str
    """Its format."""
    properties: dict[str, str]
    """Properties of the file: its writer, its count of frames, and the like."""
    meshes: list[MeshInfo]
    """Its meshes."""
    others: dict[str, str]
    """Objects that are no meshes: path and kind."""
    channels: list[ChannelInfo]
    """Numbers that change over time."""


def info(path: PathLike) -> FileInfo:
    """Content of a mesh or cache file, as ``drapery info`` says. Raises InputError if it is missing or cannot be read."""
    found = json.loads(_native.info(os.fspath(path)))
    meshes = [MeshInfo(**_tuples(mesh)) for mesh in found["meshes"]]
    channels = [ChannelInfo(**channel) for channel in found["channels"]]
    return FileInfo(found["format"], dict(found["properties"]), meshes, dict(found["others"]), channels)


def _tuples(mesh: dict[str, Any]) -> dict[str, Any]:
    """The same with tuples for lists of a fixed length, and a mapping for pairs."""
    pairs = {name: None if mesh[name] is None else tuple(mesh[name]) for name in ("faces", "times", "bounds", "uvs")}
    return {**mesh, **pairs, "face_sets": dict(mesh["face_sets"])}
