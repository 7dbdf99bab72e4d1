"""Blender as a judge: imports an Alembic or USD file as an artist would, and writes what it shows at the given frames.

    python blender_import.py cache.abc answer.npz fps frame [frame ...]

`bpy` can be loaded once in a process and keeps global state, hence a process of its own. Positions are in the world,
z up; corners are in Blender's order (each face turned the other way round than in the file).
"""

import math
import sys

import bpy
import numpy as np


def values(collection, name, width, kind=np.float32):
    found = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, found)
    return found.reshape(-1, width) if width > 1 else found


def main():
    path, answer_path, fps, *frames = sys.argv[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = int(fps)
    if path.endswith(".abc"):
        bpy.ops.wm.alembic_import(filepath=path, as_background_job=False, set_frame_range=True)
    else:
        bpy.ops.wm.usd_import(filepath=path, set_frame_range=True)
    (thing,) = [thing for thing in bpy.data.objects if thing.type == "MESH"]

    positions, velocities = [], []
    for frame in frames:
        scene.frame_set(math.floor(float(frame)), subframe=float(frame) % 1.0)
        mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        # Both are of single precision; what follows from them is not, so that nothing is lost far from the origin.
        matrix = np.array(thing.matrix_world, float)
        positions.append(values(mesh.vertices, "co", 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3])
        if "velocity" in mesh.attributes:
            velocities.append(values(mesh.attributes["velocity"].data, "vector", 3))
    answer = {
        "name": thing.name,
        "frame_range": [scene.frame_start, scene.frame_end],
        "positions": positions,
        "velocities": velocities,
        "face_starts": values(mesh.polygons, "loop_start", 1, np.int32),
        "corner_vertices": values(mesh.loops, "vertex_index", 1, np.int32),
        "materials": np.array([slot.name for slot in thing.material_slots], dtype=str),
        "material_of_face": values(mesh.polygons, "material_index", 1, np.int32),
    }
    if mesh.uv_layers:
        answer["uvs"] = values(mesh.uv_layers[0].uv, "vector", 2)
    np.savez(answer_path, **answer)


if __name__ == "__main__":
    main()
