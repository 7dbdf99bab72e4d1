"""Runs of how-to scenes for their tests: scene, pins, records, and measures of the cloth."""

import json
import re
import subprocess
import tomllib
from functools import cached_property
from pathlib import Path

import igl
import numpy as np

from crossings import Body
from farm import DRAPERY
from judges import ROOT, hdf5

HOWTO, SAMPLES = "sample_assets/howto", "sample_assets/scenes"

# Positions are stored in f32, and cloth stays within 4 m of the origin [m].
ROUNDING = 1e-6

GRAVITY = 9.81

# Parameters of a run whose integrator the solver does not choose.
SHORT_STEPS = {"solver.integrator": "semi_implicit"}


def page(name):
    """Text of a how-to page."""
    return (ROOT / "docs" / "howto" / f"{name}.md").read_text()


def fenced(name, language, number=0):
    """A fenced block of a page, by its language and its place among those."""
    blocks = page(name).split("```")[1::2]
    return [block.removeprefix(f"{language}\n") for block in blocks if block.startswith(f"{language}\n")][number]


def said(command, *arguments, code=0):
    """Returns the output of a command of `drapery`."""
    done = subprocess.run([DRAPERY, command, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == code, f"{done.returncode}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


def frames_of(scene):
    """First and last frame of a sample scene."""
    return tuple(map(int, tomllib.loads((ROOT / scene).read_text())["shot"]["frames"].split("-")))


def number(value):
    """Value of a setting in the SI unit."""
    if not isinstance(value, str):
        return float(value)
    amount, _, unit = value.partition(" ")
    return float(amount) * {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3, "N": 1.0, "mN": 1e-3, "N/m": 1.0, "Pa": 1.0, "kPa": 1e3}[unit]


class Run:
    """An output folder."""

    def __init__(self, out):
        self.out = Path(out)
        self.scene = tomllib.loads((self.out / "resolved.toml").read_text())

    @cached_property
    def caches(self):
        """HDF5 caches by their garments."""
        return {path.stem: hdf5(path) for path in sorted(self.out.glob("*.h5"))}

    def positions(self, garment):
        return self.caches[garment]["world_positions"]

    def numbers(self, garment):
        """Frame numbers, as a list."""
        return self.caches[garment]["frame_numbers"].tolist()

    def garment(self, name):
        """Table of a garment in the scene."""
        return next(table for table in self.scene["garment"] if table["name"] == name)

    def body(self, name):
        """The body of this name, which is from a file."""
        table = next(table for table in self.scene["body"] if table["name"] == name)
        return Body(Path(table["file"]))

    def pinned(self, garment, start, pin=0):
        """Vertices that a pin holds, of those that start at `start`."""
        pin = self.garment(garment)["pin"][pin]
        if "file" in pin:
            return np.array([held["vertex"] for held in json.loads(Path(pin["file"]).read_text())["pins"]])
        box = pin["where"]["box"]
        return np.flatnonzero(((start >= box["min"]) & (start <= box["max"])).all(axis=1))

    @cached_property
    def records(self):
        """Records of the frames, by their numbers."""
        lines = map(json.loads, (self.out / "run.jsonl").read_text().splitlines())
        return {line["frame"]: line for line in lines if line["record"] == "frame"}

    def count(self, name):
        """Sum of a count over all frames."""
        return sum(record["counts"].get(name, 0) for record in self.records.values())


class Bound:
    """Points bound to the nearest points of a body, as they are at a time."""

    def __init__(self, body, points, time):
        vertices = body.vertices(time)
        squared, faces, nearest = igl.point_mesh_squared_distance(np.ascontiguousarray(points), vertices, body.faces)
        self.body, self.corners, self.distances = body, body.faces[faces], np.sqrt(squared)
        a, b, c = (np.ascontiguousarray(vertices[self.corners[:, corner]]) for corner in range(3))
        self.weights = igl.barycentric_coordinates(np.ascontiguousarray(nearest), a, b, c)

    def places(self, time):
        """Returns the positions of the nearest points at another time."""
        return np.einsum("ij,ijk->ik", self.weights, self.body.vertices(time)[self.corners])


def masses(points, triangles):
    """Part of the mass of each vertex of uniform cloth, a third of the triangles around it."""
    areas = np.linalg.norm(normals(points, triangles), axis=1)
    found = np.zeros(len(points))
    np.add.at(found, triangles.ravel(), np.repeat(areas, 3))
    return found / found.sum()


def area(points, triangles):
    return 0.5 * np.linalg.norm(normals(points, triangles), axis=1).sum()


def normals(points, triangles):
    """Normals of triangles, as long as twice their areas."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return np.cross(b - a, c - a)


def volume(points, triangles):
    """Volume inside a closed surface."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    return abs(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def folds(points, triangles):
    """Angle by which each inner edge is folded [degrees], and the middles of the edges in `points`."""
    sides = {}
    for index, corners in enumerate(triangles.tolist()):
        for a, b in zip(corners, corners[1:] + corners[:1]):
            sides.setdefault((min(a, b), max(a, b)), []).append(index)
    inner = {edge: pair for edge, pair in sides.items() if len(pair) == 2}
    units = normals(points, triangles)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    first, second = np.array(list(inner.values())).T
    return np.degrees(np.arccos(np.clip((units[first] * units[second]).sum(axis=1), -1, 1))), np.array(list(inner))


def accelerations(positions, times, weights):
    """Acceleration of the centre of mass at each inner frame, by second differences."""
    centre = np.einsum("v,fvk->fk", weights, positions)
    return np.diff(centre, 2, axis=0) / (times[1] - times[0]) ** 2


def strains(positions, start, triangles):
    """Strain of each edge, against its length at the start."""
    edges = igl.edges(triangles.astype(np.int64))
    lengths = [np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1) for x in (positions, start)]
    return lengths[0] / lengths[1] - 1


def holds(whole, part):
    """Whether a part of a scene stands in it: keys of tables in any order, and tables of a list in theirs."""
    if isinstance(part, dict):
        return isinstance(whole, dict) and all(key in whole and holds(whole[key], value) for key, value in part.items())
    if isinstance(part, list) and all(isinstance(item, dict) for item in part):
        return all(any(holds(other, item) for other in whole) for item in part)
    return whole == part


def altered(scene, folder, *changes):
    """A scene with words replaced, in a folder of its own."""
    text = (ROOT / scene).read_text()
    for old, new in changes:
        assert re.search(old, text), f"{scene} has no {old}"
        text = re.sub(old, new, text)
    path = Path(folder) / Path(scene).name
    path.write_text(text)
    return path
