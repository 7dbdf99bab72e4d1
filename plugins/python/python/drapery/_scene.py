"""Scenes, shots and simulations."""

from __future__ import annotations

import json
import logging
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import Faces, FacesLike, PathLike, Vectors, plain, vectors
from ._arrays import faces as faces_of
from ._errors import UsageError
from ._native import State

_log = logging.getLogger("drapery")

Setting = Union[bool, int, float, str, Sequence[Any], Mapping[str, Any], "np.generic", "npt.NDArray[Any]"]
"""A value of a scene: what TOML has, and numbers and arrays of NumPy. A text is a text, and ``"2 mm"`` is a length."""


def _toml(value: Setting) -> str:
    """The value as it stands behind ``--set KEY=``."""
    return value if isinstance(value, str) else _inline(plain(value, "value"))


def _inline(value: Any) -> str:
    """A value of TOML on one line."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_inline(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, float) and math.isinf(value):
        return str(value)
    # Texts, other numbers, `true` and `false` are the same in JSON.
    return json.dumps(value)


@dataclass(frozen=True)
class SceneWarning:
    """Something that is possible but seldom meant."""

    rule: str | None
    """The rule that it comes from, by which a scene can silence it (docs/reference/warnings.md)."""
    object: str
    """Object of the warning; empty where the message names it."""
    message: str
    """Finding in words."""
    line: str
    """The line to write in the scene; empty where the message says what to do."""

    def __str__(self) -> str:
        parts = [self.rule, self.object, self.message]
        return ": ".join(part for part in parts if part) + (f"\n  help: {self.line}" if self.line else "")


@dataclass(frozen=True)
class Frame:
    """Summary of the work done to reach a frame."""

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
    next_integrator: str | None
    """Integrator of the frames behind this one, if it changes there."""
    counts: dict[str, int] = field(repr=False)
    """Counts of the frame, by the names of docs/reference/counts.md."""


@dataclass(frozen=True)
class Progress:
    """A frame of a run that is on the disk."""

    frame: int
    """Its number."""
    last_frame: int
    """Last frame of the run."""
    is_preroll: bool
    """Whether it lies before the first frame that is delivered."""
    done: int
    """Frames done so far, pre-roll and those of earlier attempts included."""
    total: int
    """Frames in all."""
    seconds: float
    """Time that the frame took [s]."""
    steps: int
    """Time steps; 0 for the frame at which the simulation starts."""


@dataclass(frozen=True)
class Report:
    """Outcome, files and counts of a run over all its attempts."""

    outcome: str
    """``"done"``, ``"nothing to do"`` where all frames were there, or ``"stopped"`` where somebody stopped it from outside
    (``drapery stop``): the next call resumes."""
    frame: int
    """The last frame that is done."""
    frames: int
    """Frames delivered."""
    seconds: float
    """Time that all frames took [s]."""
    files: list[Path]
    """The caches."""
    counts: dict[str, int] = field(repr=False)
    """Counts over all frames, by the names of docs/reference/counts.md."""
    exceeded: dict[str, int]
    """Counts that should have stayed zero, such as intersections in the caches."""


class Plan(Mapping[str, Any]):
    """Plan of a run with its reasons: ``drapery plan --json``, without threads and without the parts for a run of the command."""

    def __init__(self, content: dict[str, Any]) -> None:
        self._content = content

    def __getitem__(self, key: str) -> Any:
        return self._content[key]

    def __iter__(self) -> Any:
        return iter(self._content)

    def __len__(self) -> int:
        return len(self._content)

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Everything that acts on the cloth, in the order of execution: each with its settings and their sources."""
        effects: list[dict[str, Any]] = self._content["effects"]
        return effects

    def _rows(self) -> list[tuple[str, str, str]]:
        return [(effect["effect"], effect["garment"] or "", effect["because"]) for effect in self.effects]

    def __repr__(self) -> str:
        first, last = self["frames"]
        lines = [f"<drapery.Plan of '{self['shot']}', frames {first} to {last}>"]
        for garment in self["garments"]:
            lines.append(f"  garment {garment['name']}: {garment['points']} points, {garment['triangles']} triangles")
        for effect, of, because in self._rows():
            lines.append(f"  {effect}{' of ' + of if of else ''}: {because}")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        cells = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self._rows())
        rows = "".join(f"<tr>{row}</tr>" for row in cells)
        first, last = self["frames"]
        head = f"{escape(self['shot'])}, frames {first} to {last}"
        return f"<table><caption>{head}</caption><tr><th>effect</th><th>garment</th><th>because</th></tr>{rows}</table>"


class Scene:
    """A scene: where it comes from, and what is set in it. Nothing is read or simulated before somebody asks."""

    def __init__(self, native: _native.Scene) -> None:
        self._native = native

    @staticmethod
    def load(path: PathLike, settings: Mapping[str, Setting] | None = None, materials: Iterable[PathLike] = ()) -> Scene:
        """The scene of a file. ``settings`` are those of ``--set``, by parameter or dotted key; ``materials`` are folders in
        which the materials that it names are looked for.

        Raises SceneError with the line as ``element``, InputError if the file is missing.
        """
        return Scene(_native.Scene(os.fspath(path), None, _settings(settings), [os.fspath(m) for m in materials]))

    @staticmethod
    def parse(
        text: str,
        name: str = "scene",
        folder: PathLike = "",
        settings: Mapping[str, Setting] | None = None,
        materials: Iterable[PathLike] = (),
    ) -> Scene:
        """A scene of the text of a scene file. ``name`` is what messages call it. Files that it names are relative to ``folder``,
        and meshes of ``add_mesh`` are named ``memory:NAME``.

        Raises SceneError with the line as ``element``.
        """
        paths = [os.fspath(m) for m in materials]
        return Scene(_native.Scene(None, (text, name, os.fspath(folder)), _settings(settings), paths))

    @staticmethod
    def from_dict(
        content: Mapping[str, Any],
        name: str = "scene",
        folder: PathLike = "",
        settings: Mapping[str, Setting] | None = None,
        materials: Iterable[PathLike] = (),
    ) -> Scene:
        """A scene of what a scene file holds: tables are mappings, and ``[[garment]]`` is a list of mappings; ``name`` and
        ``folder`` as in ``parse``. Arrays and numbers of NumPy are taken.

        Raises SceneError; its line is one of the text that the mappings are turned into.
        """
        return Scene.parse(_native.toml_of(plain(content)), name, folder, settings, materials)

    @property
    def name(self) -> str:
        """Name of the shot."""
        return self._native.name

    @property
    def path(self) -> Path | None:
        """The scene file, if it is of one."""
        return self._native.path

    def to_toml(self) -> str:
        """The whole scene as the text of a scene file, which ``parse`` takes: settings, parameters and defaults with their values, and
        where each comes from, as in ``resolved.toml`` of a run. Files that it names are opened, and have absolute paths.

        Raises SceneError or InputError with all that is wrong.
        """
        return self._native.to_toml()

    def to_dict(self) -> dict[str, Any]:
        """The same as mappings, which ``from_dict`` takes. Raises what ``to_toml`` raises."""
        return _native.content_of(self.to_toml())

    def set(self, key: str, value: Setting) -> None:
        """Sets a value, as ``--set KEY=VALUE`` does. Raises SceneError if there is no such key; nothing is set then."""
        self._native.set(key, _toml(value))

    def add_mesh(self, name: str, positions: npt.ArrayLike, faces: FacesLike) -> None:
        """Adds a mesh, which the scene names ``memory:NAME``, or puts it in the place of one.

        ``positions`` has the shape (points, 3) [m]; ``faces`` is a list of the points of each face, counter-clockwise seen from
        outside, an array of the shape (faces, corners), or ``Faces``. Raises UsageError for a wrong shape or type, InputError
        with the face, corner or vertex as ``element`` if numbers do not fit.
        """
        self._native.add_mesh(name, vectors(positions, "positions"), *faces_of(faces))

    def validate(self) -> list[SceneWarning]:
        """Reads all inputs over all frames, as ``drapery check`` does; returns the warnings, and logs them.

        Raises SceneError or InputError with all that is wrong.
        """
        return self.shot()._validate()

    def plan(self) -> Plan:
        """Returns the plan of a run with its reasons. Raises the errors of ``validate``."""
        return self.shot().plan()

    def shot(self, frames: tuple[int, int] | None = None) -> Shot:
        """The shot with all its inputs checked; ``frames`` are the first and the last that are delivered, all when left out.

        Raises SceneError or InputError with all that is wrong, UsageError for frames that it cannot have.
        """
        return Shot(self._native.shot(frames))

    def simulate(self) -> Simulation:
        """A simulation at its start, with all inputs checked."""
        return self.shot().simulate()

    def __repr__(self) -> str:
        of = "" if self.path is None else f" of {self.path}"
        return f"<drapery.Scene '{self.name}'{of}>"


def _settings(settings: Mapping[str, Setting] | None) -> list[tuple[str, str]]:
    return [(key, _toml(value)) for key, value in (settings or {}).items()]


class Shot:
    """A scene that was checked with all its inputs. It can be run or stepped any number of times."""

    def __init__(self, native: _native.Shot) -> None:
        self._native = native

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name

    @property
    def frames(self) -> tuple[int, int]:
        """First and last frame."""
        _, first, last = self._native.frames
        return first, last

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self._native.fps

    @property
    def garments(self) -> list[str]:
        """Names of the garments."""
        return self._native.garments

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        return self._native.bodies

    @property
    def warnings(self) -> list[SceneWarning]:
        """Warnings of input that is possible but seldom meant."""
        return [SceneWarning(*parts) for parts in self._native.warnings]

    def _validate(self) -> list[SceneWarning]:
        warnings = self.warnings
        warnings += [SceneWarning(None, "", message, "") for message in self._native.check_pins()]
        for warning in warnings:
            _log.warning("%s", warning)
        return warnings

    def plan(self) -> Plan:
        """Returns the plan of a run with its reasons."""
        return Plan(json.loads(self._native.plan))

    def simulate(self) -> Simulation:
        """A simulation at its start."""
        return Simulation(self._native.simulate())

    def run(
        self, out: PathLike, progress: Callable[[Progress], None] | None = None, overwrite: bool = False,
    ) -> Report:
        """Runs the whole shot into a folder, as ``drapery run`` does, or resumes the run that the folder holds.

        ``progress`` is called after every frame, in the thread that called. Ctrl-C, or an exception of ``progress``, stops at a
        checkpoint and is raised; called again, the run resumes, with the bytes of one that never stopped. ``overwrite`` replaces
        a run that the folder holds.

        Raises SolverError where the solver gives up, OutputError where the disk refuses or the folder holds something else.
        """

        def hear(kind: str, *parts: Any) -> None:
            if kind == "frame":
                frame = Progress(*parts)
                _log.info("frame %d, %d of %d, %.3f s", frame.frame, frame.done, frame.total, frame.seconds)
                if progress is not None:
                    progress(frame)
            elif kind == "note":
                _log.warning("%s", *parts)
            elif kind == "resumed":
                _log.info("resumes after frame %d, with %d frames done", *parts)
            elif kind == "underway":
                _log.info("frame %d takes long: %d states, %.0f %% of its time", parts[0], parts[1], 100 * parts[2])

        found = self._native.run(os.fspath(out), overwrite, f"drapery.Shot.run({os.fspath(out)!r})", hear)
        exceeded = dict(found.pop("exceeded"))
        for name, total in exceeded.items():
            _log.warning("%s: %d in all frames, and should be 0", name, total)
        return Report(exceeded=exceeded, **found)

    def __repr__(self) -> str:
        first, last = self.frames
        return f"<drapery.Shot '{self.name}', frames {first} to {last}: {', '.join(self.garments)}>"


class Simulation:
    """A shot at some frame, stepped in memory. Any thread may use it, one at a time; other threads run while the solver works."""

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
    def start_frame(self) -> int:
        """Frame at which the simulation starts, pre-roll included."""
        return self._native.frames[0]

    @property
    def first_frame(self) -> int:
        """First frame of the scene."""
        return self._native.frames[1]

    @property
    def last_frame(self) -> int:
        """Last frame."""
        return self._native.frames[2]

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self._native.fps

    @property
    def frame(self) -> int:
        """The last frame that was reached."""
        return self._native.frame

    @property
    def time(self) -> float:
        """Time of that frame, counted from the start [s]."""
        return (self.frame - self.start_frame) / self.fps

    @property
    def summary(self) -> Frame | None:
        """Summary of the work done to reach it; None at the start, and where a file was restored."""
        found = self._native.summary
        return None if found is None else Frame(**found)

    def advance(self) -> Frame:
        """Simulates up to the next frame.

        Raises UsageError at the last frame, SolverError where the solver gives up. Ctrl-C stops between two steps and is raised;
        called again, it resumes, and its result equals that of a frame that was never stopped, bit for bit.
        """
        self._native.advance()
        frame = self.summary
        assert frame is not None, "a frame that was reached has a summary"
        _log.debug("frame %d, %d steps", frame.frame, frame.steps)
        return frame

    def advance_to(self, frame: int) -> None:
        """Simulates until a frame is reached. Raises what ``advance`` raises."""
        if frame > self.last_frame:
            raise UsageError(f"frame {frame}: the shot ends at frame {self.last_frame}\n  help: raise shot.frames")
        while self.frame < frame:
            self.advance()

    def move_body(self, body: str, positions: npt.ArrayLike) -> None:
        """Puts a body that is a mesh where it is to be at the next frame: an array of the shape (points, 3) [m].

        It moves there on straight lines, and stays until it is put elsewhere. Raises InputError with body, frame and vertex;
        nothing has moved then.
        """
        self._native.move_body(body, vectors(positions, "positions"))

    def set(self, path: str, value: npt.ArrayLike) -> None:
        """Gives a number of the scene another value from the next frame on: ``"garment.skirt.stretch.stiffness"``,
        ``"body.hero.friction"``, ``"gravity.acceleration"``, in SI units.

        Raises SceneError with the path; nothing has changed then. States do not hold the value.
        """
        try:
            numbers: list[float] = np.asarray(value, dtype=np.float64).reshape(-1).tolist()
        except (TypeError, ValueError) as error:
            raise UsageError(f"{path}: {value!r} is no number\n  help: give a number, or the three of a vector") from error
        self._native.set(path, numbers)

    def positions(self, garment: str | None = None) -> Vectors:
        """Positions of a garment, of the first one if none is named: (points, 3) [m], in the order of its mesh.

        The array is of this frame and stays so; it cannot be written to.
        """
        return self._native.positions(self._garment(garment))

    def velocities(self, garment: str | None = None) -> Vectors:
        """Velocities likewise: (points, 3) [m/s]."""
        return self._native.velocities(self._garment(garment))

    def faces(self, garment: str | None = None) -> Faces:
        """Faces of a garment, in the order of its mesh."""
        return Faces(*self._native.faces(self._garment(garment)))

    def save(self) -> State:
        """The present state, in memory; it belongs to this simulation."""
        return self._native.save()

    def restore(self, state: State) -> None:
        """Goes back to a state, or forward, with the same bits from there on. Raises UsageError for one of another simulation."""
        self._native.restore(state)

    def save_file(self, path: PathLike) -> None:
        """Writes the present state to a file, as a whole or not at all. Raises OutputError if the disk refuses, or if the file is there and
        is no checkpoint."""
        self._native.save_file(os.fspath(path))

    def restore_file(self, path: PathLike) -> None:
        """Resumes from a file of a simulation, or a checkpoint of a run, of the same scene with the same inputs."""
        self._native.restore_file(os.fspath(path))

    def _garment(self, name: str | None) -> str:
        return self.garments[0] if name is None else name

    def __repr__(self) -> str:
        try:
            at = f"frame {self.frame}"
        except UsageError:
            at = "work"
        garments = ", ".join(self.garments)
        return f"<drapery.Simulation '{self.name}' at {at} of {self.start_frame} to {self.last_frame}: {garments}>"
