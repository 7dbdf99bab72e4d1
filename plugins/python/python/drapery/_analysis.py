"""Studies, verification of caches, and materials."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import PathLike
from ._errors import UsageError
from ._scene import Scene, Setting, _toml

_log = logging.getLogger("drapery")


@dataclass(frozen=True)
class StudyRow:
    """A setting of a study: what it costs, and how far it is from the reference."""

    label: str
    """The setting in words."""
    settings: dict[str, str]
    """Settings of the row, for ``Scene.load``."""
    seconds: float
    """Median time of a frame [s]."""
    spread: float
    """Median distance of times of a frame from it [s]."""
    error: float | None
    """RMS distance from the reference over the compared frames [m]; None without a reference, and for the reference."""
    largest_error: float | None
    """Largest distance of a vertex [m]."""
    validity: str | None
    """Validity of the error: ``Yes``, ``BelowFloor``, ``NotConverged`` or ``Unchecked`` (docs/guide/study.md)."""
    order: float | None
    """Order of convergence from the next coarser setting to this one."""
    on_front: bool
    """Whether no other setting is both faster and more accurate."""
    is_sound: bool
    """Whether its counts let it be recommended."""
    steps: int
    """Time steps of its run."""
    errors: npt.NDArray[np.float64] = field(repr=False)
    """RMS distance from the reference at each compared frame [m], of the shape (frames,); empty without a reference."""


class Study:
    """Accuracy and cost of the settings of a scene, as ``drapery study`` compares them."""

    def __init__(self, content: dict[str, Any]) -> None:
        self._content = content

    @property
    def rows(self) -> list[StudyRow]:
        """Settings: the scene as it is, accuracy, then meshes."""
        return [
            StudyRow(**{**row, "settings": dict(row["settings"]), "errors": _array(row["errors"])})
            for row in self._content["rows"]
        ]

    @property
    def recommended(self) -> StudyRow | None:
        """The setting to take within the budget, or at the knee of cost and error; None where nothing can be said."""
        at = self._content["recommended"]
        return None if at is None else self.rows[at]

    @property
    def frames(self) -> npt.NDArray[np.int64]:
        """Numbers of the compared frames, of the shape (frames,)."""
        return np.asarray(self._content["frames"], np.int64)

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Their times, counted from the start of the simulation [s]."""
        return _array(self._content["times"])

    @property
    def own_error(self) -> npt.NDArray[np.float64]:
        """Self-error of the reference at each of them [m]; empty where it was not checked."""
        return _array(self._content["own_error"])

    @property
    def window(self) -> int:
        """Number of compared frames, from the first on, that errors are taken over: no prediction reaches farther."""
        window: int = self._content["window"]
        return window

    @property
    def record(self) -> dict[str, Any]:
        """The record as it stands in ``study.json``: every run with its costs, counts and figures."""
        record: dict[str, Any] = self._content["record"]
        return record

    @property
    def folder(self) -> Path:
        """Folder with ``study.json``, ``study.csv`` and ``report.html``."""
        return Path(self._content["folder"])

    def table(self) -> str:
        """The table that ``drapery study`` prints."""
        table: str = self._content["table"]
        return table.rstrip()

    def __repr__(self) -> str:
        return f"<drapery.Study of '{self.record['scene']['shot']}'>\n{self.table()}"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.table())}</pre>"


def _array(values: Sequence[float | None]) -> npt.NDArray[np.float64]:
    return np.asarray([np.nan if value is None else value for value in values], np.float64)


def study(
    scene: Scene,
    out: PathLike,
    vary: Mapping[str, Iterable[Setting]] | None = None,
    frames: tuple[int, int] | None = None,
    max_wall: float = 600,
    budget: float | None = None,
    grid: bool = False,
    latin: int = 0,
    copies: int = 4,
    repeats: int = 3,
    overwrite: bool = False,
) -> Study:
    """Runs a scene with many settings and compares them with a converged run, as ``drapery study`` does, or resumes the study that the folder ``out`` holds.

    ``vary`` says what is varied, by the names that ``drapery study --vary`` takes, such as ``{"cfl": [4, 2, 1]}``; when left out,
    steps and solves, and one at a time what else costs time. ``max_wall`` is what it may take [s], ``budget`` the most time
    that a frame may take with the recommended setting [s]. ``grid`` takes all combinations, ``latin`` this number of them. ``copies``
    are runs with shifted positions, ``repeats`` runs of every setting whose time is given.

    Ctrl-C ends it and is raised; what was run is in the folder, and called again it resumes. Raises SceneError, InputError,
    UsageError if there is too little time for one run, OutputError if the folder holds another study.
    """

    def hear(kind: str, *parts: Any) -> None:
        if kind == "note":
            _log.warning("%s", *parts)
        else:
            label, number, of, seconds = parts
            _log.info("run %d of %d: %s%s", number, of, label, "" if seconds is None else f", about {seconds:.1f} s")

    if repeats < 1 or copies < 0 or latin < 0:
        raise UsageError(f"copies {copies}, repeats {repeats}, latin {latin}\n  help: give one repeat or more, and none below 0")
    request = {
        "out": os.fspath(out),
        "vary": [(name, [_toml(value) for value in values]) for name, values in (vary or {}).items()],
        "grid": grid,
        "latin": latin,
        "frames": frames,
        "max_wall": max_wall,
        "budget": budget,
        "copies": copies,
        "repeats": repeats,
        "overwrite": overwrite,
        "command": f"drapery.study({scene!r})",
    }
    return Study(json.loads(_native.study(scene._native, request, hear)))


def read_study(record: PathLike) -> Study:
    """The study of a ``study.json``. Raises InputError if it is missing or something else."""
    return Study(json.loads(_native.study_of(os.fspath(record))))


@dataclass(frozen=True)
class Verification:
    """Findings of ``verify`` in caches."""

    facts: list[str]
    """Facts that are good to know."""
    warnings: list[str]
    """Points that some application may stumble over."""
    failures: list[str]
    """Rules that are broken."""

    @property
    def ok(self) -> bool:
        """Whether all rules are met."""
        return not self.failures

    def __repr__(self) -> str:
        head = "all rules are met" if self.ok else f"{len(self.failures)} rules are broken"
        lines = [f"warning: {line}" for line in self.warnings] + [f"broken: {line}" for line in self.failures]
        return "\n  ".join([f"<drapery.Verification: {head}>", *self.facts, *lines])


def verify(*caches: PathLike, body: PathLike | None = None, record: PathLike | None = None) -> Verification:
    """Whether other applications can load these caches and no cloth passes through cloth, as ``drapery verify`` says.

    ``body`` is a mesh whose intersections with them are counted, ``record`` the folder of the run that wrote them: whether every
    frame is still what it wrote. Raises InputError for a cache that is missing or cannot be read as a whole.
    """
    if not caches and record is None:
        raise UsageError("there is nothing to verify\n  help: give caches, or the folder of a run as `record`")
    paths = [os.fspath(path) for path in caches]
    of = [None if path is None else os.fspath(path) for path in (body, record)]
    return Verification(*_native.verify(paths, *of))


@dataclass(frozen=True)
class Material:
    """A material: a preset, or one of a file."""

    name: str
    """Its word in the scene."""
    summary: str
    """Description in a line."""
    density: float
    """Mass per area [kg/m²]."""
    thickness: float
    """Thickness [m]."""
    stretch_stiffness: float
    """Stiffness along the threads, mean of warp and weft, for springs [N/m]."""
    warp: float
    """Stiffness along the warp, for membrane elements [N/m]."""
    weft: float
    """Stiffness along the weft [N/m]."""
    shear: float
    """Stiffness in shear [N/m]."""
    bending_rigidity: float
    """Mean of all directions [N·m]."""
    strain_limit: float
    """Largest strain that it takes."""
    load: float | None
    """Force per width at the largest strain, up to which it stiffens [N/m]; None for one that does not."""
    linearity: float
    """Linearity of the curve of force by strain up to there."""
    damping_ratio: float
    """Damping as a fraction of critical."""
    friction: float
    """Coulomb friction against bodies."""
    provenance: str
    """Source of the numbers."""
    path: Path | None
    """The file that it is of; None for a preset."""


def materials(folders: Iterable[PathLike] = ()) -> dict[str, Material]:
    """All materials that a scene finds, by their names: the presets, then those of files in these folders.

    Raises InputError or SceneError for a file that cannot be read.
    """
    found = _native.materials([os.fspath(folder) for folder in folders])
    return {material["name"]: Material(**material) for material in found}
