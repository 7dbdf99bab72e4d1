"""Strain and contact of cloth that is shown, as numbers and colours; nothing here knows Blender. Needs numpy."""

import re

import numpy as np

from .ramp import BEYOND, RAMP

METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}


def transformed(points, matrices):
    """Points after matrices of an archive, the closest one first; `points` are bytes of single precision, three a point."""
    places = np.frombuffer(points, np.float32).reshape(-1, 3).astype(float)
    for numbers in matrices:
        matrix = np.array(numbers).reshape(4, 4)
        places = places @ matrix[:3, :3] + matrix[3, :3]
    return places


def polygons(counts, indices):
    """Faces as tuples of vertices, from the bytes of an archive."""
    corners = np.frombuffer(indices, np.int32).tolist()
    ends = np.cumsum(np.frombuffer(counts, np.int32)).tolist()
    return [tuple(corners[begin:end]) for begin, end in zip([0, *ends], ends)]


def edges_of(counts, indices):
    """Pairs of vertices, each edge of the faces once."""
    counts, corners = np.frombuffer(counts, np.int32), np.frombuffer(indices, np.int32)
    after = np.arange(1, len(corners) + 1)
    ends = np.cumsum(counts)
    after[ends - 1] = ends - counts
    pairs = np.sort(np.stack([corners, corners[after]], axis=1), axis=1)
    return np.unique(pairs, axis=0)


def strains_of(places, rest, edges):
    """Strain of each edge: change of its length by its length at rest, with vertices in rows."""
    now, then = (np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) for points in (places, rest))
    return now / np.maximum(then, 1e-12) - 1.0


def largest_at_vertices(values, edges, count):
    """At each vertex the largest value of its edges; 0 where all are negative, or there are none."""
    found = np.zeros(count)
    np.maximum.at(found, edges[:, 0], values)
    np.maximum.at(found, edges[:, 1], values)
    return found


def colours_of(shares):
    """Opaque RGBA of shares: the ramp between 0 and 1, one colour beyond."""
    shares = np.asarray(shares, float)
    steps = np.linspace(0.0, 1.0, len(RAMP))
    found = np.ones((len(shares), 4), np.float32)
    for channel, values in enumerate(zip(*RAMP)):
        found[:, channel] = np.interp(shares, steps, values)
    found[shares > 1.0, :3] = BEYOND
    return found


def length_at(value, frame):
    """A length of a scene file in metres: a number, a text with its unit, or a curve of either over frames."""
    if isinstance(value, list):
        keys = [(key, length_at(entry, frame)) for key, entry in value]
        return float(np.interp(frame, *zip(*keys)))
    if isinstance(value, str):
        number, unit = re.fullmatch(r"\s*([-+.\deE]+)\s*(\w+)\s*", value).groups()
        return float(number) * METRES[unit]
    return float(value)


def thickness_between(resolved, garment, other, frame):
    """Distance in metres that a garment keeps from another object (its table, "garment" or "body", and its name) at a frame; None
    where they ignore each other. `resolved` is the scene file that a run keeps, with all numbers."""
    tables = {(kind, each["name"]): each for kind in ("garment", "body") for each in resolved.get(kind, [])}
    own = "garment", garment
    for rule in resolved.get("contact", []):
        first, second = rule["between"]
        if is_named(first, own) and is_named(second, other) or is_named(first, other) and is_named(second, own):
            if rule.get("ignore"):
                return None
            if "thickness" in rule:
                return length_at(rule["thickness"], frame)
    far = length_at(tables[other].get("thickness", 1e-3), frame)
    return far if other[0] == "body" else max(far, length_at(tables[own].get("thickness", 0.5e-3), frame))


def is_named(side, table):
    """Whether a side of a rule of contact names a table: its name, or its kind and name with a dot between."""
    return side in (table[1], ".".join(table))
