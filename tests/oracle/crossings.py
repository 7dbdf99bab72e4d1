"""Finds triangles of cloth that cross, by the exact predicates of libigl.

    python tests/oracle/crossings.py out/twister [--body body.abc]

prints, for the caches of one run, how many pairs of triangles cross in each frame. Positions are taken as they are
stored, in f32, and widened to f64, which changes nothing; on them libigl decides with Shewchuk's exact predicates,
behind a tree of boxes. Triangles that only touch are found as well. All garments of a run are one surface, so each is
judged against itself and against the others.
"""

import argparse
import sys
from pathlib import Path

import igl
import igl.predicates
import numpy as np

from body_depth import RELEASE_REACH, distance_to_triangles, simulated_surface
from judges import hdf5, official


class Cloth:
    """All garments of a run as one surface, frame by frame."""

    def __init__(self, caches):
        self.names = list(caches)
        self.caches = list(caches.values())
        counts = [cache["positions"].shape[1] for cache in self.caches]
        starts = np.cumsum([0, *counts[:-1]])
        # Quads are not flat: the cache says how they are cut.
        parts = [cache["triangles"].astype(np.int64) for cache in self.caches]
        self.faces = np.concatenate([part + start for part, start in zip(parts, starts)])
        self.face_starts = np.cumsum([0, *map(len, parts)])
        self.frames = self.caches[0]["frame_numbers"]
        self.times = self.caches[0]["times"]
        assert all(np.array_equal(cache["frame_numbers"], self.frames) for cache in self.caches)

    @classmethod
    def of_run(cls, out):
        """The caches of an output folder."""
        caches = {path.stem: hdf5(path) for path in sorted(Path(out).glob("*.h5"))}
        assert caches, f"no caches in {out}"
        return cls(caches)

    def positions(self, index):
        """Points of all garments in the frame with this index."""
        points = np.concatenate([cache["positions"][index] for cache in self.caches]).astype(float)
        assert np.isfinite(points).all(), f"frame {self.frames[index]} has points that are not finite"
        return points

    def name(self, face):
        """Garment and number of a face."""
        garment = int(np.searchsorted(self.face_starts, face, side="right")) - 1
        return f"{self.names[garment]} {face - self.face_starts[garment]}"

    def crossings(self, index):
        """Pairs of faces that cross or touch in a frame, without sharing the points where they do."""
        return crossing_pairs(self.positions(index), self.faces)


def crossing_pairs(vertices, faces):
    """Pairs of triangles (rows of two face numbers) of a surface that cross or touch."""
    return igl.predicates.find_self_intersections(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))[1]


def body_crossings(points, faces, vertices, body_faces):
    """Cloth faces that cross the body: those elsewhere, and those within reach of where the body crosses itself."""
    found = igl.predicates.find_intersections(
        np.ascontiguousarray(points), np.ascontiguousarray(faces), np.ascontiguousarray(vertices), body_faces
    )[1]
    crossing = np.unique(found[:, 0]) if len(found) else np.empty(0, np.int64)
    itself = np.unique(crossing_pairs(vertices, body_faces)) if len(crossing) else []
    reach = distance_to_triangles(points[faces[crossing]].reshape(-1, 3), vertices, body_faces[itself])
    pinched = reach.reshape(-1, 3).min(axis=1, initial=np.inf) < RELEASE_REACH
    return crossing[~pinched], crossing[pinched]


class Body:
    """An animated body."""

    def __init__(self, path):
        self.samples = official(path)
        self.faces = simulated_surface(self.samples)

    def vertices(self, time):
        """Its points at a time, which has to be that of a sample."""
        times = self.samples["times"]
        sample = int(np.argmin(abs(times - time)))
        assert abs(times[sample] - time) < 1e-6, f"the body has no sample at {time} s"
        return np.ascontiguousarray(self.samples["world_positions"][sample], float)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", help="output folder of a run")
    parser.add_argument("--body", help="Alembic file of a body")
    arguments = parser.parse_args()
    cloth = Cloth.of_run(arguments.out)
    body = Body(Path(arguments.body).resolve()) if arguments.body else None
    total = 0
    for index, frame in enumerate(cloth.frames):
        pairs = cloth.crossings(index)
        line = f"{len(pairs)} pairs of cloth triangles"
        if len(pairs):
            line += f", first {cloth.name(pairs[0, 0])} with {cloth.name(pairs[0, 1])}"
        total += len(pairs)
        if body:
            outside, pinched = body_crossings(
                cloth.positions(index), cloth.faces, body.vertices(cloth.times[index]), body.faces
            )
            line += f"; {len(outside)} cloth triangles cross the body, {len(pinched)} near where it crosses itself"
            total += len(outside)
        print(f"frame {frame}: {line}")
    sys.exit(total > 0)


if __name__ == "__main__":
    main()
