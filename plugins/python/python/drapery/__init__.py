"""Drapery, an offline cloth solver: scenes, simulations frame by frame, whole shots.

All lengths are in metres with Y up, times in seconds; arrays of points have the shape (points, 3). What is stepped or run here
has the bits of `drapery run`.

>>> import drapery
>>> scene = drapery.Scene.load("hanging_sheet.toml")
>>> simulation = scene.simulate()
>>> simulation.advance().steps
>>> simulation.positions("sheet")
"""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._native import DraperyError, InputError, SceneError, SolverError, State, __version__, set_threads

__all__ = [
    "DraperyError", "Frame", "InputError", "Progress", "Report", "Scene", "SceneError", "Simulation", "SolverError", "State",
    "__version__", "set_threads",
]

_log = logging.getLogger("drapery")

Setting = Union[bool, int, float, str, Sequence[Any], Mapping[str, Any]]
"""A value of a scene: what TOML has. A text is a text; `"2 mm"` is a length."""

PathLike = Union[str, "os.PathLike[str]"]


def _toml(value: Setting) -> str:
    """The value as it stands behind `--set KEY=`."""
    if isinstance(value, str):
        return value
    line = _native.Scene._toml_of(json.dumps({"value": _plain(value)}))
    return line.removeprefix("value = ").rstrip("\n")


def _plain(value: Any) -> Any:
    """Arrays and numbers of NumPy as lists and numbers."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value


def _points(positions: npt.ArrayLike) -> npt.NDArray[np.float64]:
    array = np.asarray(positions)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"positions are numbers, and these are {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"positions have the shape (points, 3), and these {array.shape}")
    return array.astype(np.float64, copy=False)


@dataclass(frozen=True)
class Frame:
    """What was done to reach a frame."""

    frame: int
    """Its number."""
    steps: int
    """Time steps."""
    cg_iterations: int
    """Iterations of all damping solves."""
    dt_min: float
    """Shortest step [s]."""
    dt_max: float
    """Longest step [s]."""
    kinetic_energy: float
    """At the frame [J]."""
    potential_energy: float
    """At the frame [J]."""
    max_strain: float
    """Relative change of the length of the most stretched edge."""
    counts: dict[str, int]
    """What was counted, by the names of docs/reference/counts.md."""


@dataclass(frozen=True)
class Progress:
    """A frame of a run that is on the disk."""

    frame: int
    """Its number."""
    done: int
    """Frames done so far, pre-roll and those of earlier attempts included."""
    total: int
    """Frames in all."""
    seconds: float
    """What it took [s]."""


@dataclass(frozen=True)
class Report:
    """What a run wrote."""

    frame: int
    """The last frame that is done."""
    frames: int
    """Frames delivered."""
    seconds: float
    """What all frames took, in all attempts [s]."""
    files: list[Path]
    """The caches."""
    was_there: bool
    """Whether all frames were there already."""
    exceeded: dict[str, int]
    """Counts that should have stayed zero."""


class Scene:
    """A scene: where it comes from, and what is set in it."""

    def __init__(self, native: _native.Scene) -> None:
        self._native = native

    @staticmethod
    def load(path: PathLike, settings: Mapping[str, Setting] | None = None, materials: Iterable[PathLike] = ()) -> Scene:
        """The scene of a file. `settings` are those of `--set`, by parameter or dotted key; `materials` are folders in which the
        materials that it names are looked for.

        Raises SceneError with the line as `element`, InputError if the file is missing.
        """
        return Scene(_native.Scene._load(os.fspath(path), _settings(settings), [os.fspath(m) for m in materials]))

    @staticmethod
    def parse(
        text: str, name: str = "scene", folder: PathLike = "", settings: Mapping[str, Setting] | None = None,
        materials: Iterable[PathLike] = (),
    ) -> Scene:
        """A scene of the text of a scene file. Files that it names are relative to `folder`; meshes of `add_mesh` it names
        `memory:NAME`."""
        paths = [os.fspath(m) for m in materials]
        return Scene(_native.Scene._parse(text, name, os.fspath(folder), _settings(settings), paths))

    @staticmethod
    def from_dict(content: Mapping[str, Any], name: str = "scene", folder: PathLike = "") -> Scene:
        """A scene of what a scene file holds: tables are mappings, `[[garment]]` is a list of mappings."""
        return Scene.parse(_native.Scene._toml_of(json.dumps(_plain(content))), name, folder)

    @property
    def name(self) -> str:
        """Name of the shot."""
        return self._native.name

    @property
    def path(self) -> Path | None:
        """The scene file, if it is of one."""
        return self._native.path

    def set(self, key: str, value: Setting) -> None:
        """Sets a value, as `--set KEY=VALUE` does. Raises SceneError if there is no such key; nothing is set then."""
        self._native._set(key, _toml(value))

    def add_mesh(self, name: str, positions: npt.ArrayLike, faces: npt.ArrayLike | Sequence[Sequence[int]]) -> None:
        """Adds a mesh, which the scene names `memory:NAME`: positions (points, 3) [m], and for each face its points,
        counter-clockwise seen from outside. Raises InputError, with the face, corner or vertex, if they do not fit."""
        listed = [list(map(int, face)) for face in faces]  # type: ignore[union-attr, arg-type]
        if any(point < 0 for face in listed for point in face):
            raise ValueError("points of faces are counted from 0")
        corners = [point for face in listed for point in face]
        self._native._add_mesh(name, _points(positions), [len(face) for face in listed], corners)

    def validate(self) -> list[str]:
        """Reads all inputs over all frames, as `drapery check` does; returns the warnings. Raises what is wrong."""
        warnings = self._native.validate()
        for warning in warnings:
            _log.warning("%s", warning)
        return warnings

    def simulate(self) -> Simulation:
        """A simulation at its start, with all inputs checked."""
        return Simulation(self._native.simulate())

    def run(
        self, out: PathLike, progress: Callable[[Progress], None] | None = None, overwrite: bool = False,
    ) -> Report:
        """Runs the whole shot into a folder, as `drapery run` does, or goes on with the run that it holds. `progress` is called
        after every frame. Ctrl-C, or an exception of `progress`, stops it at a checkpoint, from which the next call goes on."""

        def tell(frame: int, done: int, total: int, seconds: float) -> None:
            _log.info("frame %d, %d of %d, %.3f s", frame, done, total, seconds)
            if progress is not None:
                progress(Progress(frame, done, total, seconds))

        found = self._native._run(os.fspath(out), overwrite, tell)
        exceeded = dict(found.pop("exceeded"))
        for name, total in exceeded.items():
            _log.warning("%s: %d", name, total)
        return Report(exceeded=exceeded, **found)

    def __repr__(self) -> str:
        return repr(self._native)


def _settings(settings: Mapping[str, Setting] | None) -> list[tuple[str, str]]:
    return [(key, _toml(value)) for key, value in (settings or {}).items()]


class Simulation:
    """A scene at some frame. Any thread may use it; calls wait for each other, and others run while the solver works."""

    def __init__(self, native: _native.Simulation) -> None:
        self._native = native

    @property
    def name(self) -> str:
        """Name of the shot."""
        return self._native.name

    @property
    def garments(self) -> list[str]:
        """Names of the garments."""
        return self._native.garments

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        return self._native.bodies

    @property
    def warnings(self) -> list[str]:
        """What is suspicious in the scene but was accepted."""
        return self._native.warnings

    @property
    def start_frame(self) -> int:
        """Where it starts, pre-roll included."""
        return self._native.start_frame

    @property
    def first_frame(self) -> int:
        """First frame of the shot."""
        return self._native.first_frame

    @property
    def last_frame(self) -> int:
        """Last frame of the shot."""
        return self._native.last_frame

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self._native.fps

    @property
    def frame(self) -> int:
        """The last frame that was reached."""
        return self._native.frame

    @property
    def summary(self) -> Frame | None:
        """What was done to reach it; None at the start."""
        found = self._native.summary
        return None if found is None else Frame(**found)

    def advance(self) -> Frame:
        """Goes on to the next frame. Raises DraperyError at the last frame, SolverError where the solver gives up. Ctrl-C stops
        between two steps; called again, it goes on with the bits of a frame that was never stopped."""
        frame = Frame(**self._native.advance())
        _log.debug("frame %d, %d steps", frame.frame, frame.steps)
        return frame

    def advance_to(self, frame: int) -> None:
        """Goes on until a frame is reached."""
        while self.frame < frame:
            self.advance()

    def move_body(self, body: str, positions: npt.ArrayLike) -> None:
        """Puts a body that is a mesh where it is to be at the next frame: (points, 3) [m]. It moves there on straight lines, and
        stays until it is put elsewhere. Raises InputError with body, frame and vertex."""
        self._native._move_body(body, _points(positions))

    def positions(self, garment: str | None = None) -> npt.NDArray[np.float64]:
        """Positions of a garment, of the first one if none is named: (points, 3) [m], in the order of its mesh. The array is of
        this frame and stays so; it cannot be written to."""
        return self._native.positions(self.garments[0] if garment is None else garment)

    def velocities(self, garment: str | None = None) -> npt.NDArray[np.float64]:
        """Velocities likewise [m/s]."""
        return self._native.velocities(self.garments[0] if garment is None else garment)

    def faces(self, garment: str | None = None) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:
        """Number of corners of each face, and the point of each corner, face by face."""
        return self._native.faces(self.garments[0] if garment is None else garment)

    def save(self) -> State:
        """The present state, in memory; it belongs to this simulation."""
        return self._native.save()

    def restore(self, state: State) -> None:
        """Goes back to a state, or forward, with the same bits from there on."""
        self._native.restore(state)

    def save_file(self, path: PathLike) -> None:
        """Writes the present state to a file, as a whole or not at all."""
        self._native.save_file(os.fspath(path))

    def restore_file(self, path: PathLike) -> None:
        """Goes on from a file of a simulation, or a checkpoint of a run, of the same scene with the same inputs."""
        self._native.restore_file(os.fspath(path))

    def __repr__(self) -> str:
        return repr(self._native)
