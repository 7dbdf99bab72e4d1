"""Asks the outside programs, each in a process of its own, and reads Drapery's HDF5 caches."""

import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SHARED = ROOT.parent / "shared" / "data"


def ask(script, path, *arguments):
    """The answer of one of the judges' scripts about a file, as a dictionary of arrays."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.npz"
        command = [sys.executable, str(HERE / script), str(path), str(answer), *map(str, arguments)]
        # Not in the project's folder: Blender's module looks for files beside the working directory.
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert done.returncode == 0, f"{script} refuses {path}:\n{done.stdout}{done.stderr}"
        with np.load(answer, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}


def official(path, *object_path):
    """Contents of an archive as the official Alembic library reads them."""
    return ask("official_alembic.py", path, *object_path)


def blender(path, fps, frames):
    """Contents of an archive at the frames as Blender shows them."""
    return ask("blender_import.py", path, fps, *frames)


def hdf5(path):
    """The committed frames of an HDF5 cache, as a dictionary of arrays; `positions` as stored, counted from `origin`."""
    with h5py.File(path, "r") as file:
        committed = file["committed"][:] == 1
        answer = {name: file[name][:] for name in ("face_counts", "face_indices", "triangles")}
        for name in ("positions", "velocities", "times", "frame_numbers"):
            answer[name] = file[name][: len(committed)][committed]
        answer["origin"] = file.attrs.get("origin", np.zeros(3))
        answer["world_positions"] = answer["origin"] + answer["positions"].astype(float)
        return answer


def z_up(vectors):
    """Blender's turn of a y-up file."""
    return np.stack([vectors[..., 0], -vectors[..., 2], vectors[..., 1]], axis=-1)


def triangles(face_counts, face_indices):
    """Fans of the faces, turned so that they are counter-clockwise seen from outside (Alembic's are clockwise)."""
    found = []
    start = 0
    for count in face_counts:
        corners = face_indices[start : start + count]
        found += [(corners[0], corners[i + 1], corners[i]) for i in range(1, count - 1)]
        start += count
    return np.array(found, dtype=np.int64)


def both_cuts(counts, indices):
    """Triangles along both diagonals of quads: one set of them each."""
    first, other, start = [], [], 0
    for count in counts:
        corners = indices[start : start + count]
        start += count
        if count == 4:
            a, b, c, d = corners
            first += [(a, b, c), (a, c, d)]
            other += [(b, c, d), (b, d, a)]
        else:
            assert count == 3
            first.append(tuple(corners))
            other.append(tuple(corners))
    return [np.array(cut, np.int64) for cut in (first, other)]
