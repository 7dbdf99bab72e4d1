from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__version__: str

class DraperyError(Exception):
    """What went wrong, in words."""

    code: int
    """Exit code of the command for the same fault."""
    object: str | None
    """Name of the garment or body, or path of the file."""
    frame: int | None
    """The frame."""
    element: int | None
    """Vertex, face, edge or corner, from 0; of a scene the line, from 1."""

class SceneError(DraperyError):
    """The scene is wrong."""

class InputError(DraperyError):
    """An input is missing, or holds what cannot be used."""

class SolverError(DraperyError):
    """The solver gave up."""

def set_threads(count: int) -> None:
    """Sets the number of threads of all simulations, once, before anything is simulated; it changes no bit of a result."""

class Scene:
    name: str
    path: Path | None
    @staticmethod
    def _load(path: str, settings: list[tuple[str, str]], materials: list[str]) -> Scene: ...
    @staticmethod
    def _parse(
        text: str, name: str, folder: str, settings: list[tuple[str, str]], materials: list[str],
    ) -> Scene: ...
    @staticmethod
    def _toml_of(json: str) -> str: ...
    def _set(self, key: str, value: str) -> None: ...
    def _add_mesh(
        self, name: str, positions: npt.NDArray[np.float64], face_counts: list[int], corners: list[int],
    ) -> None: ...
    def validate(self) -> list[str]: ...
    def simulate(self) -> Simulation: ...
    def _run(
        self, out: str, overwrite: bool, progress: Callable[[int, int, int, float], None] | None,
    ) -> dict[str, Any]: ...

class State:
    """A state of a simulation, to go back to."""

    frame: int

class Simulation:
    name: str
    garments: list[str]
    bodies: list[str]
    warnings: list[str]
    start_frame: int
    first_frame: int
    last_frame: int
    fps: float
    frame: int
    summary: dict[str, Any] | None
    def _move_body(self, body: str, positions: npt.NDArray[np.float64]) -> None: ...
    def advance(self) -> dict[str, Any]: ...
    def positions(self, garment: str) -> npt.NDArray[np.float64]: ...
    def velocities(self, garment: str) -> npt.NDArray[np.float64]: ...
    def faces(self, garment: str) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.uint32]]: ...
    def save(self) -> State: ...
    def restore(self, state: State) -> None: ...
    def save_file(self, path: str) -> None: ...
    def restore_file(self, path: str) -> None: ...
