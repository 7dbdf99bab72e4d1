"""Caches as arrays: Alembic (.abc), HDF5 (.h5) and USD (.usd), read and written."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import Faces, FacesLike, PathLike, Vectors, faces, indices, numbers, vectors
from ._errors import UsageError


class Uvs(tuple[npt.NDArray[np.float32], npt.NDArray[np.uint32]]):
    """Texture coordinates of the shape (values, 2), and the value of each face corner."""

    __slots__ = ()

    @property
    def values(self) -> npt.NDArray[np.float32]:
        """Texture coordinates, of the shape (values, 2)."""
        return self[0]

    @property
    def indices(self) -> npt.NDArray[np.uint32]:
        """Value of each face corner, of the shape (corners,)."""
        return self[1]


class Units(NamedTuple):
    """Unit and axis of a file. What is read is in metres with Y up in any case."""

    length: str | None
    """Unit of length: ``mm``, ``cm``, ``in``, ``ft`` or ``m``; None for one of a stage that is none of these."""
    up: str
    """Axis that points up: ``Y`` or ``Z``."""


class CacheMesh:
    """A mesh of a cache: ``mesh[frame]`` are its positions at a frame, ``len(mesh)`` is the number of its frames. Nothing is kept in
    memory: every array is read when it is asked for."""

    def __init__(self, native: _native.Cache, number: int, name: str) -> None:
        self._native, self._number, self._name = native, number, name

    @property
    def name(self) -> str:
        """Full path of the object in the file."""
        return self._name

    @property
    def frames(self) -> list[int] | list[float]:
        """Numbers of the frames that are complete, ascending; of samples where nobody says the frame rate of the file. Whole frames,
        or where no sample is at one, what there is: 1001.5 is half a frame behind 1001."""
        frames, are_whole = self._native.frames(self._number)
        return [int(frame) for frame in frames] if are_whole else frames

    @property
    def point_count(self) -> int:
        """Number of points of the first frame."""
        return self._native.point_count(self._number)

    @property
    def faces(self) -> Faces:
        """Faces of the first frame, counter-clockwise seen from outside."""
        return Faces(*self._native.faces(self._number))

    @property
    def triangles(self) -> npt.NDArray[np.uint32]:
        """The triangles that were simulated, or the faces cut into triangles: (triangles, 3)."""
        return self._native.triangles(self._number)

    @property
    def uvs(self) -> Uvs | None:
        """Texture coordinates, if there are any."""
        found = self._native.uvs(self._number)
        return None if found is None else Uvs(found)

    def positions(self, frame: float) -> Vectors:
        """Positions at a frame in the world, or at a sample between frames: (points, 3) [m], Y up whatever the file's unit and axis
        are. They were stored in single precision. Raises UsageError if there is no such frame, InputError if it is damaged."""
        return self._native.positions(self._number, frame)

    def velocities(self, frame: float) -> Vectors | None:
        """Velocities at a frame: (points, 3) [m/s]; None where the cache stores none. Raises what ``positions`` raises."""
        return self._native.velocities(self._number, frame)

    def attributes(self, frame: float) -> dict[str, npt.NDArray[np.float64]]:
        """Attributes for shading and checks at a frame, by their words in ``[output] attributes``; those that the cache holds.

        ``normals`` are of length one, one for each point (points, 3), or for each face corner (corners, 3) in the order of ``faces``
        where the mesh has hard edges. ``rest`` are positions at rest (points, 3) [m], Y up. ``strain``, ``contact`` and
        ``thickness`` [m] are (points,). Raises what ``positions`` raises.
        """
        return self._native.attributes(self._number, frame)

    def __getitem__(self, frame: float) -> Vectors:
        """Positions at the frame of this number, as ``positions``."""
        return self.positions(frame)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.frames)

    def __contains__(self, frame: object) -> bool:
        """Whether the frame of this number is there."""
        return frame in self.frames

    def __iter__(self) -> Iterator[tuple[float, Vectors]]:
        """All frames, one after the other: number and positions."""
        for frame in self.frames:
            yield frame, self.positions(frame)

    def read(self, frames: Sequence[float] | None = None) -> npt.NDArray[np.float64]:
        """Positions of these frames, of all when left out: (frames, points, 3) [m], all in memory."""
        chosen = self.frames if frames is None else list(frames)
        found = np.empty((len(chosen), self.point_count, 3))
        for row, frame in zip(found, chosen):
            positions = self.positions(frame)
            if positions.shape != row.shape:
                raise UsageError(
                    f"frame {frame}: {self.name} has {len(positions)} points, and {len(row)} at first\n  help: read its frames one by one"
                )
            row[:] = positions
        return found

    def __repr__(self) -> str:
        return f"<drapery.CacheMesh '{self.name}': {self.point_count} points, {_range(self.frames)}>"


def _range(frames: Sequence[float]) -> str:
    if not frames:
        return "no frames yet"
    return f"frame {frames[0]}" if len(frames) == 1 else f"frames {frames[0]} to {frames[-1]}"


class Cache:
    """A cache that is read: ``cache[name]`` is a mesh, and iterating it gives all. One that is still being written may be read,
    too: it has the frames that are complete."""

    def __init__(self, native: _native.Cache, path: Path) -> None:
        self._native, self._path = native, path
        self._meshes = [CacheMesh(native, number, name) for number, name in enumerate(native.objects)]

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def meshes(self) -> list[CacheMesh]:
        """Its meshes, in the order of their paths."""
        return list(self._meshes)

    @property
    def mesh(self) -> CacheMesh:
        """The mesh of a cache that holds one. Raises UsageError if it holds several."""
        if len(self._meshes) != 1:
            names = ", ".join(mesh.name for mesh in self._meshes)
            raise UsageError(f"{self.path}: it holds {len(self._meshes)} meshes\n  help: choose one of `meshes`: {names}")
        return self._meshes[0]

    @property
    def fps(self) -> float | None:
        """Frames per second, if the file tells or they were said."""
        return self._native.fps

    @property
    def units(self) -> Units:
        """Unit and axis of the file. What is read is in metres with Y up in any case."""
        return Units(*self._native.units)

    def __getitem__(self, name: str) -> CacheMesh:
        """The mesh of this path, or the only one whose path ends with this name. Raises UsageError if there is none."""
        found = [mesh for mesh in self._meshes if name in (mesh.name, mesh.name.rpartition("/")[2])]
        exact = [mesh for mesh in found if mesh.name == name] or found
        if len(exact) != 1:
            names = ", ".join(mesh.name for mesh in self._meshes)
            what = "no mesh has this name" if not exact else "several meshes have this name"
            raise UsageError(f"{self.path}: {name!r}: {what}\n  help: choose one of {names}")
        return exact[0]

    def __len__(self) -> int:
        """Number of meshes."""
        return len(self._meshes)

    def __iter__(self) -> Iterator[CacheMesh]:
        """Its meshes, in the order of their paths."""
        return iter(self._meshes)

    def __repr__(self) -> str:
        return f"<drapery.Cache {self.path}: {', '.join(repr(mesh) for mesh in self._meshes)}>"


def open_cache(path: PathLike, fps: float | None = None) -> Cache:
    """Opens an Alembic, HDF5 or USD cache, of Drapery or of another program. ``fps`` is the rate in frames per second of an
    Alembic file that does not say it.

    Raises InputError if the file is missing, damaged or no cache, or states another rate.
    """
    return Cache(_native.Cache(os.fspath(path), fps), Path(path))


class CacheWriter:
    """A cache that is written, frame by frame; a context manager, which closes it. After every frame the file is valid, also
    when the process is killed."""

    def __init__(
        self,
        path: PathLike,
        positions: npt.ArrayLike,
        faces: FacesLike,
        frames: tuple[int, int],
        fps: float | Fraction = 24,
        name: str | None = None,
        uvs: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        velocities: bool = False,
        length: str = "m",
        up: str = "Y",
        overwrite: bool = False,
    ) -> None:
        """Begins a cache; the extension of the file says its format.

        ``positions`` has the shape (points, 3) [m] and ``faces`` is as in ``Scene.add_mesh``; where the points are decides how
        faces with more than three corners are cut. ``frames`` are the first and the last one, ``name`` is that of the object,
        ``uvs`` are texture coordinates (values, 2) with the value of each corner. ``velocities`` says whether every frame comes
        with them. ``length`` (``mm``, ``cm``, ``in``, ``ft``, ``m``) and ``up`` (``Y``, ``Z``) are unit and axis of the file;
        what is handed over is in metres with Y up in any case.

        Raises OutputError if the file is there and ``overwrite`` is not set, or cannot be created; UsageError, InputError.
        """
        self._path = Path(path)
        mesh, rate = _arguments(positions, faces), _rate(fps)
        corners = None if uvs is None else (numbers(np.asarray(uvs[0]), "uvs", (None, 2), np.float32), indices(uvs[1], "uvs"))
        plan: dict[str, Any] = {
            "name": self._path.stem if name is None else name,
            "positions": mesh[0],
            "face_counts": mesh[1].counts,
            "corners": mesh[1].corners,
            "uvs": corners,
            "frames": frames,
            "fps": (rate.numerator, rate.denominator),
            "length": length,
            "up": up,
            "velocities": velocities,
            "overwrite": overwrite,
        }
        self._native = _native.CacheWriter(os.fspath(path), plan)

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    def write(self, positions: npt.ArrayLike, velocities: npt.ArrayLike | None = None) -> int:
        """Appends a frame: positions (points, 3) [m] and velocities (points, 3) [m/s], Y up; returns its number.

        Raises InputError with frame and vertex for what is no number or does not fit, OutputError if the disk refuses; the
        frames before stay.
        """
        rates = None if velocities is None else vectors(velocities, "velocities")
        return self._native.write(vectors(positions, "positions"), rates)

    def close(self) -> None:
        """Brings everything to the disk. Fewer frames than were announced may be written. Raises OutputError."""
        self._native.close()

    def __enter__(self) -> CacheWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<drapery.CacheWriter {self.path}>"


def _rate(fps: float | Fraction) -> Fraction:
    """A frame rate as the fraction that is meant: 23.976 is 24000/1001."""
    if not (math.isfinite(fps) and 0 < fps <= 1e6):
        raise UsageError(f"`fps` is {fps}\n  help: give frames per second, as in 24 or 23.976")
    if isinstance(fps, Fraction):
        return fps
    of_television = Fraction(round(fps * 1.001) * 1000, 1001)
    if abs(fps - round(fps)) > 1e-3 and abs(fps - of_television) < 1e-3:
        return of_television
    return Fraction(fps).limit_denominator(1001)


def _arguments(positions: npt.ArrayLike, given: FacesLike) -> tuple[Vectors, Faces]:
    return vectors(positions, "positions"), faces(given)
