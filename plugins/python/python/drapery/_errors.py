"""Exceptions of the package. The text of each names the fault, the place and the remedy; its attributes hold the parts."""

from __future__ import annotations

from typing import Any


class DraperyError(Exception):
    """Something that Drapery refuses or that has failed; the classes below say whose fault it is."""

    code: int
    """Exit code of the command for the same fault (``drapery --help``)."""
    object: str | None
    """Name of the garment or body, or path of the file, that is meant."""
    frame: int | None
    """The frame that is meant."""
    element: int | None
    """Vertex, face, edge or corner, counted from 0; of a scene the line, counted from 1."""

    def __init__(
        self,
        message: str,
        code: int = 2,
        object: str | None = None,
        frame: int | None = None,
        element: int | None = None,
    ) -> None:
        super().__init__(message)
        self.code, self.object, self.frame, self.element = code, object, frame, element

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.code, self.object, self.frame, self.element)


class UsageError(DraperyError, ValueError):
    """The request is not possible: a garment or a frame that is not there, an array of a wrong shape."""


class SceneError(DraperyError):
    """The scene is wrong; ``element`` is the line."""


class InputError(DraperyError):
    """An input is missing, or holds what cannot be used, such as a position that is no number."""


class OutputError(DraperyError):
    """An output could not be created, holds something else, or the disk refuses."""


class SolverError(DraperyError):
    """The solver gave up."""


class NoMemoryError(DraperyError, MemoryError):
    """The machine has too little memory for the shot."""


class InternalError(DraperyError):
    """A bug in Drapery; please report it."""
