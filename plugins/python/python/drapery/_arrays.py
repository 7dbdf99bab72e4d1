"""Types that are taken for arrays, and their conversion."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Union

import numpy as np
import numpy.typing as npt

from ._errors import UsageError

PathLike = Union[str, "os.PathLike[str]"]
"""A path."""

Vectors = npt.NDArray[np.float64]
"""Positions [m] or velocities [m/s], Y up, of the shape (points, 3)."""


class Faces(NamedTuple):
    """Faces of a mesh, counter-clockwise seen from outside."""

    counts: npt.NDArray[np.uint32]
    """Number of corners of each face, of the shape (faces,)."""
    corners: npt.NDArray[np.uint32]
    """Point of each corner, face by face, of the shape (corners,)."""


FacesLike = Union[Faces, npt.NDArray[Any], Sequence[Sequence[int]]]
"""Faces; or an array of the shape (faces, corners) of a mesh whose faces have all as many; or a list of the points of each."""


def vectors(values: npt.ArrayLike, name: str) -> Vectors:
    """An array of the shape (points, 3) of doubles in one piece of memory; not copied if it is one."""
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise UsageError(f"`{name}`: {error}\n  help: give an array of the shape (points, 3)") from error
    return numbers(array, name, (None, 3), np.float64)


def numbers(array: npt.NDArray[Any], name: str, shape: tuple[int | None, ...], dtype: type) -> npt.NDArray[Any]:
    """The array as one of this shape and type."""
    fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape))
    if not fits:
        wanted = ", ".join("n" if n is None else str(n) for n in shape)
        raise UsageError(f"`{name}` has the shape {array.shape}\n  help: give one of the shape ({wanted})")
    if array.dtype.kind not in "fiu":
        raise UsageError(f"`{name}` holds {array.dtype}, which are no real numbers\n  help: give numbers of {np.dtype(dtype)}")
    return np.ascontiguousarray(array, dtype=dtype)


def indices(values: Any, name: str) -> npt.NDArray[np.uint32]:
    """A flat array of counts or indices."""
    array = np.asarray(values)
    if array.size == 0:
        return np.zeros(0, np.uint32)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise UsageError(f"`{name}` has the shape {array.shape} and holds {array.dtype}\n  help: give whole numbers in a row")
    if array.min() < 0 or array.max() > np.iinfo(np.uint32).max:
        at = int(np.argmax((array < 0) | (array > np.iinfo(np.uint32).max)))
        raise UsageError(f"`{name}`: number {at} is {array[at]}\n  help: points and corners are counted from 0")
    return np.ascontiguousarray(array, dtype=np.uint32)


def faces(given: FacesLike) -> Faces:
    """Faces of whatever form."""
    if isinstance(given, Faces):
        return Faces(indices(given.counts, "faces.counts"), indices(given.corners, "faces.corners"))
    if isinstance(given, np.ndarray):
        if given.ndim != 2:
            raise UsageError(f"`faces` has the shape {given.shape}\n  help: give one of the shape (faces, corners), or a list of faces")
        count, width = given.shape
        return Faces(np.full(count, width, np.uint32), indices(given.ravel(), "faces"))
    corners = [corner for face in given for corner in face]
    return Faces(indices([len(face) for face in given], "faces"), indices(corners, "faces"))


def plain(value: Any, place: str = "") -> Any:
    """Arrays and numbers of NumPy, and paths, as what a scene file has; `place` is where it stands, for messages."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), place)
    if isinstance(value, np.generic):
        return plain(value.item(), place)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return {str(key): plain(inner, f"{place}.{key}" if place else str(key)) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner, f"{place}[{number}]") for number, inner in enumerate(value)]
    if isinstance(value, (str, bool, int)) or (isinstance(value, float) and not math.isnan(value)):
        return value
    what = repr(value) if isinstance(value, float) else f"of the type {type(value).__name__}"
    raise UsageError(f"`{place}` is {what}\n  help: a scene holds texts, numbers, lists and tables; leave out what is not set")
